"""Frames: the readings of sensors, on the device, as numpy on demand."""

import io
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.hits import reading
from rigcast.kernels.rays.stamps import stamps
from rigcast.sensors.device import DeviceArray
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.scene.parts.part import Owner
from rigcast.sensors.scene.shape_ids import ShapeIds
from rigcast.sensors.specs.lens import Lens
from rigcast.sensors.specs.pattern import Pattern

from .arrays.frame_arrays import FrameArrays

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL import Image


class Source(NamedTuple):
    """Data shared by all frames of one pattern: the sensor's name, and the tables for their fields."""

    sensor: str
    shape_ids: ShapeIds
    body_of_shape: wp.array
    firing_times: wp.array | None
    ring: wp.array | None
    column: wp.array | None
    pattern: Pattern


@dataclass(eq=False, repr=False)  # not frozen: constructing one takes long for small frames
class Frame:
    """One reading of one sensor.

    sensor: its name. time: when its first ray was fired [s]. pose: (4, 4) float64, the sensor's frame in the world.

    Per-ray fields are Warp arrays on the device, `frame.range.numpy()` on the host, of the sensor's `shape`:
    (beams, columns) for a lidar with a table of beams, (height, width) for a camera, (rays,) for others. They belong
    to the frame; a later step does not change them. Fields other than range, normal and geom_id are computed from these
    when you ask for them. Points, depth and body_id are written by the next cast itself if they were asked of the frame
    whose arrays it reuses.

    On the CPU `numpy()` is a view: editing it edits the frame, and what is computed from it later. Edit a copy:
    `frame.range.numpy().copy()`.

    For a batch of worlds every per-ray field has a first axis for the world, and time (nworld,) and pose (nworld, 4, 4)
    are Warp arrays of float64; `world(k)` is the frame of one world. Rays of worlds that are not active read NaN. With
    two returns in a batch, vectors are arrays of vec3 and vec3d, because Warp arrays have at most four axes; `numpy()`
    and DLPack show the fifth.

    Where `range` is not finite: points are NaN, ids -1, normals 0. A hit on a flex, skin or prop has `geom_id` -1.
    """

    # float and numpy array, or Warp arrays for many worlds; Any, so that type checkers accept either use
    time: Any
    pose: Any
    shape: tuple[int, ...]
    _arrays: FrameArrays
    _source: Source

    def __reduce__(self) -> NoReturn:
        kind = type(self).__name__
        raise TypeError(f"a {kind} holds memory of its device: copy or pickle arrays of it, such as range.numpy()")

    def __repr__(self) -> str:
        return f"{type(self).__name__}(sensor={self.sensor!r}, time={self.time!r}, shape={self.shape})"

    @property
    def sensor(self) -> str:
        """Its name."""
        return self._source.sensor

    @property
    def range(self) -> DeviceArray:
        """(...) float32 [m]: distance along the ray; +inf nothing in range, -inf too near, NaN invalid (REP-117)."""
        return self._arrays.range

    @property
    def normal(self) -> DeviceArray:
        """(..., 3) float32: unit outward normal of what was hit, in the sensor's frame; 0 where nothing was."""
        return self._arrays.normal

    @cached_property
    def geom_id(self) -> DeviceArray:
        """(...) int32: MuJoCo's id of the geom, -1 where none was hit."""
        return self._ids("geom")

    @cached_property
    def flex_id(self) -> DeviceArray | None:
        """(...) int32: MuJoCo's id of the flex, -1 where none was hit; None in a scene without flexes."""
        return self._ids("flex")

    @cached_property
    def skin_id(self) -> DeviceArray | None:
        """(...) int32: MuJoCo's id of the skin, -1 where none was hit; None in a scene without skins."""
        return self._ids("skin")

    @cached_property
    def prop_id(self) -> DeviceArray | None:
        """(...) int32: the index of the prop in the list of props, -1 where none was hit; None without props."""
        return self._ids("prop")

    @cached_property
    def body_id(self) -> DeviceArray:
        """(...) int32: MuJoCo's id of the body that was hit; -1 on a miss, and for a flex or skin of several bodies."""
        return self._values("body_id", partial(reading.look_up, self._source.body_of_shape, self._arrays.hits.shape))

    @cached_property
    def points(self) -> DeviceArray:
        """(..., 3) float32 [m], in the sensor's frame; NaN where the range is not finite."""
        return self._of_rays("points", reading.points)

    @cached_property
    def points_world(self) -> DeviceArray:
        """(..., 3) float64 [m], in the world; NaN where the range is not finite."""
        return self._of_rays("points_world", reading.world_points)

    @cached_property
    def stamp(self) -> DeviceArray:
        """(...) float64 [s]: when each ray was fired, `time` plus its firing time in the pattern."""
        distance = self._arrays.hits.distance
        begun = self.time
        if not isinstance(begun, wp.array):
            begun = wp.full(1, begun, dtype=wp.float64, device=distance.device)
        return self._values("stamp", partial(stamps, begun, self._source.firing_times, distance.size))

    if TYPE_CHECKING:  # fields of some types of frames, declared so that `rig.sense(data)["front"].depth` has a type

        @property
        def ring(self) -> DeviceArray: ...
        @property
        def column(self) -> DeviceArray: ...
        @property
        def depth(self) -> DeviceArray: ...
        @property
        def depth_16bit(self) -> DeviceArray: ...
        @property
        def intensity(self) -> DeviceArray: ...
        @property
        def intrinsics(self) -> NDArray[np.float64]: ...
        @property
        def lens(self) -> Lens | None: ...
        @property
        def depth_scale(self) -> float: ...

    def world(self, k: int) -> Self:
        """The frame of world k, which shares memory with this one. Raises InputError for a frame of one world."""
        if not isinstance(self.time, wp.array):
            raise InputError(f"Frame.world: sensor {self.sensor!r}: got a frame of one world, expected one of many")
        count = self.time.size
        require_type(f"Frame.world: sensor {self.sensor!r}: world", k, int, np.integer)
        if not 0 <= k < count:
            raise InputError(f"Frame.world: sensor {self.sensor!r}: no world {k}, expected 0 to {count - 1}")
        return replace(self, **self._of_world(int(k)))

    def require_fit(self, sensor: str, shape: tuple[int, ...], device: wp.Device) -> None:
        """Raise InputError unless the arrays have room for another reading of this sensor, of this shape."""
        what = f"Rig.sense: out: sensor {sensor!r}: got a frame of"
        if self.sensor != sensor:
            raise InputError(f"{what} sensor {self.sensor!r}, expected one of its own")
        if self._arrays.is_part:  # else the fields of the frame of all worlds would be from two readings
            raise InputError(f"{what} one of many worlds, expected one of a reading of one world")
        own = self._arrays.range.device
        if shape != self.shape or own != device:
            raise InputError(f"{what} shape {self.shape} on {own}, expected {shape} on {device}")

    def start_again(self) -> FrameArrays:
        """The arrays, for another reading."""
        self._arrays.start_again()
        return self._arrays

    def require_one_world(self) -> None:
        """Raise InputError for a frame of many worlds."""
        if np.shape(self.pose) != (4, 4):
            raise InputError(
                f"sensor {self.sensor!r}: got a frame of {len(self.pose)} worlds, expected one of one world, such as "
                "frame.world(0)"
            )

    def _of_world(self, k: int) -> dict[str, Any]:
        """The fields of the frame of world k."""
        time: wp.array = self.time
        pose: wp.array = self.pose
        return {
            "time": float(time[k : k + 1].numpy()[0]),
            "pose": pose[k : k + 1].numpy()[0],
            "shape": self.shape[1:],
            "_arrays": self._arrays.of_world(k),
        }

    def picture(self) -> "Image.Image":
        """The reading as a picture, 1200 pixels wide, with scales in metres; notebooks show it by themselves.

        A camera: z-depth (ranges if it sees behind itself), normals, geoms. A lidar: range image above a top-down view.
        A height scan: the heights of its grid. Raises InputError for a frame of many worlds.
        """
        self.require_one_world()
        return self._drawn()

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw depth, range image or points into matplotlib's `ax` (None: the current one); what has no range is grey.

        Raises InputError where matplotlib is not installed, and for a frame of many worlds.

        >>> frame.plot().figure.savefig("frame.pdf")
        """
        from rigcast.sensors.preview.plot import titled_axes

        self.require_one_world()
        axes = titled_axes(ax, self.sensor, self.time)
        self._plot(axes)
        return axes

    # Drawing modules are imported where they are used, because most rigs need no pictures.

    def _drawn(self) -> "Image.Image":
        from rigcast.sensors.preview.height_scan import draw_height_scan

        distance, points = self.range.numpy().ravel(), self.points.numpy().reshape(-1, 3)
        return draw_height_scan(self.sensor, self.time, distance, points, self._source.pattern)

    def _plot(self, axes: "Axes") -> None:
        from rigcast.sensors.preview.plot import plot_from_above

        plot_from_above(axes, self.points.numpy().reshape(-1, 3))

    def _repr_png_(self) -> bytes | None:
        """The PNG that Jupyter shows; None for many worlds, which have no picture."""
        if np.shape(self.pose) != (4, 4):
            return None
        png = io.BytesIO()
        self.picture().save(png, format="png")
        return png.getvalue()

    def _ids(self, owner: Owner) -> Any:
        ids = self._source.shape_ids
        if owner not in ids.of_shape:
            return None
        if ids.are_shapes(owner):
            return self._arrays.shape_hit
        return self._values(f"{owner}_id", partial(ids.look_up, owner, self._arrays.hits.shape))

    def _values(self, name: str, compute: Callable[[wp.array | None], wp.array]) -> wp.array:
        return self._arrays.fields.get(name, compute, self._arrays.in_shape)

    def _of_rays(self, name: str, compute: Callable[..., wp.array]) -> wp.array:
        return self._values(name, partial(compute, self._arrays.hits.distance, self._arrays.rays))


@dataclass(eq=False, repr=False)
class LidarFrame(Frame):
    """A reading of a lidar.

    With `returns: dual` every field of each ray has a last axis of 2, before that of vectors.
    """

    _intensity: Callable[[wp.array | None], wp.array]

    @cached_property
    def ring(self) -> DeviceArray:
        """(...) int32: the row or line of each ray."""
        return self._in_each_world(self._source.ring)

    @cached_property
    def column(self) -> DeviceArray:
        """(...) int32: the place of each ray in its row or line."""
        return self._in_each_world(self._source.column)

    @cached_property
    def intensity(self) -> DeviceArray:
        """(...) float32: reflectivity of a surface facing the sensor that would return the same power.

        Of an opaque surface in clear air it is reflectivity cos(incidence). 0 where the range is not finite.
        """
        return self._values("intensity", self._intensity)

    def _of_world(self, k: int) -> dict[str, Any]:
        return super()._of_world(k) | {"_intensity": lambda _: self.intensity[k]}

    def _in_each_world(self, values: wp.array | None) -> wp.array:
        """Values of the pattern in the frame's shape; for many worlds a view, as they are stored once."""
        assert values is not None
        if values.ndim == len(self.shape):
            return values
        strides = (0, *values.strides)
        repeated = wp.array(ptr=values.ptr, dtype=values.dtype, shape=self.shape, strides=strides, device=values.device)
        repeated._ref = values  # which keeps the memory
        return repeated

    def _drawn(self) -> "Image.Image":
        from rigcast.sensors.preview.lidar import draw_lidar

        pattern = self._source.pattern.at(self.time)
        return draw_lidar(self.sensor, self.time, self.range.numpy(), self.points.numpy(), pattern)

    def _plot(self, axes: "Axes") -> None:
        from rigcast.sensors.preview.plot import plot_ranges

        plot_ranges(axes, self.range.numpy(), self._source.pattern.at(self.time))


@dataclass(eq=False, repr=False)
class CameraFrame(Frame):
    """A reading of a depth camera.

    intrinsics: (3, 3) float64 [pixels], the camera matrix. lens: its distortion, None for a pinhole.
    depth_scale: depth of one step of `depth_16bit` [m].
    """

    intrinsics: NDArray[np.float64]
    lens: Lens | None
    depth_scale: float
    _intensity: Callable[[wp.array | None], wp.array]

    @cached_property
    def depth(self) -> DeviceArray:
        """(height, width) float32 [m]: z-depth in the optical frame; +-inf and NaN where the range is."""
        return self._of_rays("depth", reading.z_depth)

    @cached_property
    def depth_16bit(self) -> DeviceArray:
        """(height, width) uint16 [depth_scale]: depth as drivers give it, 0 where it is not known or too large."""
        return self._values("depth_16bit", partial(reading.depth_16bit, self.depth.flatten(), self.depth_scale))

    @cached_property
    def intensity(self) -> DeviceArray:
        """(height, width) float32: infrared light that comes back, reflectivity |cos incidence| / range^2.

        1 is a white surface that faces the camera at 1 m, 0 where nothing was hit. Errors of the depth do not affect
        it: where `stereo` or `time_of_flight` gives no reading, it is that of the surface that is there.
        """
        return self._values("intensity", self._intensity)

    def _of_world(self, k: int) -> dict[str, Any]:
        return super()._of_world(k) | {"_intensity": lambda _: self.intensity[k]}

    def _drawn(self) -> "Image.Image":
        from rigcast.sensors.preview.camera import draw_camera

        fields = (self.depth, self.range, self.normal, self.geom_id)
        return draw_camera(self.sensor, self.time, *(field.numpy() for field in fields))

    def _plot(self, axes: "Axes") -> None:
        from rigcast.sensors.preview.plot import plot_depth

        plot_depth(axes, self.depth.numpy(), self.range.numpy())


def as_frames(what: str, frames: Iterable[Frame], sensors: Collection[str] | None = None) -> list[Frame]:
    """Frames as a list; if `sensors` is given, they must be of these. what: their name in messages.

    Raises InputError for anything else, such as the dict that `Rig.sense` returns.
    """
    if isinstance(frames, Mapping | Frame) or not isinstance(frames, Iterable):
        hint = ", such as its values()" if isinstance(frames, Mapping) else ""
        raise InputError(f"{what}: got {type(frames).__name__}, expected a list of frames{hint}")
    listed = list(frames)
    for frame in listed:
        require_type(what, frame, Frame)
        if sensors is not None and frame.sensor not in sensors:
            raise InputError(f"{what}: no sensor {frame.sensor!r}, {expected_one_of(frame.sensor, list(sensors))}")
    return listed
