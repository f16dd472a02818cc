"""A rig: sensors mounted on a MuJoCo model, read together."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Literal, NamedTuple

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import Rays
from rigcast.kernels.infrared import infrared
from rigcast.kernels.packets.sorting import sort_into_packets
from rigcast.kernels.reading import intensity, read
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.physics.depth_camera import DepthPhysics
from rigcast.sensors.physics.lidar import LidarPhysics
from rigcast.sensors.scene.hits import Hits
from rigcast.sensors.scene.part import Owner
from rigcast.sensors.scene.props import as_props
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan, yaw_only
from rigcast.sensors.specs.lidar import Lidar
from rigcast.sensors.specs.mount import BoundMount
from rigcast.sensors.specs.pattern import Pattern
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.surface import Surface

from .frame import CameraFrame, Frame, LidarFrame
from .schedule import Schedule

Sensor = Lidar | DepthCamera | HeightScan


class WorldRays(NamedTuple):
    """The rays of one reading in the world, (*shape, 3) float64: origins [m] and unit directions."""

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]


class Rig:
    """Sensors on one model.

    Args:
        model: the model that carries the sensors.
        sensors: `Lidar`, `DepthCamera` and `HeightScan`, with different names.
        device: a Warp device; None takes CUDA if it is present, else "cpu".
        seed: of all random numbers of the rig, 0 to 2^63 - 1.
        props: meshes that are not in the model, as for `Scene`.
        surfaces: how some of the model and props reflects, as for `Scene`.
        on_unsupported: "error" or "warn", as for `Scene`.

    Raises:
        InputError: two sensors of one name, mounts or filters that name what the model does not have (all of
            them at once), or geometry that rays cannot hit.

    >>> rig = rigcast.Rig(model, [rigcast.DepthCamera(name="front", mount=rigcast.Mount(camera="head"))])
    >>> for frame in rig.step(data):
    ...     frame.depth.numpy()
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        sensors: Iterable[Sensor],
        device: wp.DeviceLike = None,
        seed: int = 0,
        *,
        props: Sequence[Prop] = (),
        surfaces: Sequence[Surface] = (),
        on_unsupported: Literal["error", "warn"] = "error",
    ) -> None:
        require_type("Rig: model", model, mujoco.MjModel)
        self.sensors = _as_sensors(sensors)
        self.props = as_props(props)
        self.seed = _as_seed(seed)
        repeated = [name for name, n in Counter(s.name for s in self.sensors).items() if n > 1]
        if repeated:
            raise InputError(f"Rig: names must differ, got {', '.join(map(repr, repeated))} more than once")
        faults = [f"sensor {s.name!r}: {fault}" for s in self.sensors for fault in s.faults(model)]
        if faults:
            raise InputError("\n".join(faults))
        self.model = model
        self.scene = Scene(model, device, self.props, surfaces=surfaces, on_unsupported=on_unsupported)
        self._data = mujoco.MjData(model)
        self._mounted = {s.name: _Mounted.on(self.scene, s) for s in self.sensors}
        self._schedules = {s.name: Schedule(s.rate_hz, model.opt.timestep) for s in self.sensors}

    def sense(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, Frame]:
        """One frame of each of these sensors (None: of all), of the world at `data.time`.

        Kinematics are worked out on a private copy; `data` is only read.
        """
        mounted = self._select(names)
        self._look(data)
        return {m.spec.name: self._frame(m, data.time) for m in mounted}

    def step(self, data: mujoco.MjData) -> Iterator[Frame]:
        """The frames that fell due since the last call, in the order of their times; call it after each `mj_step`.

        A sensor with `rate_hz` falls due at every multiple of 1 / rate_hz on the clock `data.time`, one without it
        at every call. Each frame is given out once, however many fall due in one step. It shows the world at
        `data.time`, less than a timestep after `frame.time`. When the clock goes backwards the schedule starts over.
        """
        self._require_own(data)
        due = [(time, m) for m in self._mounted.values() for time in self._schedules[m.spec.name].due(data.time)]
        if not due:
            return iter(())
        self._look(data)
        return iter([self._frame(m, time) for time, m in sorted(due, key=lambda item: item[0])])

    def rays(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, WorldRays]:
        """The rays that each of these sensors would cast now."""
        mounted = self._select(names)
        self._look(data)
        return {m.spec.name: m.world_rays(self._data) for m in mounted}

    def cast(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, Hits]:
        """What the rays of each of these sensors hit now, before any range limit: distances and world normals."""
        mounted = self._select(names)
        self._look(data)
        return {
            m.spec.name: self.scene.hits(self.scene.cast_rays(m.rays(self._data), m.visible(), np.inf), m.pattern.shape)
            for m in mounted
        }

    def _select(self, names: Sequence[str] | None) -> list["_Mounted"]:
        if names is None:
            return list(self._mounted.values())
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise InputError(f"Rig: names: got {names!r}, expected a list of names, such as [{str(names)!r}]")
        for name in names:
            require_type("Rig: name of a sensor", name, str)
            if name not in self._mounted:
                raise InputError(f"Rig: no sensor {name!r}, {expected_one_of(name, list(self._mounted))}")
        return [self._mounted[name] for name in names]

    def _look(self, data: mujoco.MjData) -> None:
        """Bring the scene to the world at data.time, whose poses mj_step has not worked out yet."""
        self._require_own(data)
        self._data.time = data.time
        self._data.qpos[:] = data.qpos
        self._data.mocap_pos[:] = data.mocap_pos
        self._data.mocap_quat[:] = data.mocap_quat
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)
        mujoco.mj_flex(self.model, self._data)
        mujoco.mj_camlight(self.model, self._data)
        self.scene.update(self._data)

    def _require_own(self, data: mujoco.MjData) -> None:
        require_type("Rig: data", data, mujoco.MjData)
        if data.signature != self.model.signature:
            raise InputError("Rig: data belongs to another model than the rig")

    def _frame(self, mounted: "_Mounted", time: float) -> Frame:
        spec, pattern = mounted.spec, mounted.pattern
        if isinstance(spec, Lidar):
            return self._lidar_frame(mounted, spec, time)
        if isinstance(spec, DepthCamera):
            return self._camera_frame(mounted, spec, time)
        rays = mounted.rays(self._data)
        hits = self.scene.cast_rays(rays, mounted.visible(), spec.max_range)
        read(hits, rays, spec.min_range)
        common = (spec.name, time, mounted.pose(self._data), pattern.shape, hits, rays, *self._tables())
        return Frame(*common)

    def _lidar_frame(self, mounted: "_Mounted", spec: Lidar, time: float) -> LidarFrame:
        rays, visible, shape = mounted.rays(self._data), mounted.visible(), mounted.pattern.shape
        if mounted.physics is None:
            hits = self.scene.cast_rays(rays, visible, spec.max_range)
            read(hits, rays, spec.min_range)
            bright = partial(intensity, hits, rays, self.scene.looks().surfaces)
        else:
            reading = mounted.physics.read(rays, visible, self.seed, next(mounted.frames))
            hits, bright = reading.hits, partial(wp.array.flatten, reading.intensity)
            shape = (*shape, 2) if spec.returns == "dual" else shape
        common = (spec.name, time, mounted.pose(self._data), shape, hits, rays, *self._tables())
        return LidarFrame(*common, mounted.ring, mounted.column, bright)

    def _camera_frame(self, mounted: "_Mounted", spec: DepthCamera, time: float) -> CameraFrame:
        pattern, rays, visible = mounted.pattern, mounted.rays(self._data), mounted.visible()
        if mounted.depth_physics is None:
            hits = seen = self.scene.cast_rays(rays, visible, spec.max_range)
            read(hits, rays, spec.min_range)
        else:
            reading = mounted.depth_physics.read(rays, visible, self.seed, next(mounted.frames))
            hits, seen = reading.hits, reading.seen
        bright = partial(infrared, seen, rays.directions, self.scene.looks().reflectivity)
        common = (spec.name, time, mounted.pose(self._data), pattern.shape, hits, rays, *self._tables())
        assert pattern.intrinsics is not None
        return CameraFrame(*common, pattern.intrinsics, pattern.lens, spec.depth_scale, bright)

    def _tables(self) -> tuple[Mapping[Owner, wp.array], wp.array]:
        return self.scene.ids_in_use, self.scene.body_of_shape


def _as_sensors(sensors: object) -> tuple[Sensor, ...]:
    if isinstance(sensors, SensorSpec) or not isinstance(sensors, Iterable):
        raise InputError(f"Rig: sensors: got {type(sensors).__name__}, expected a list of sensors")
    listed = tuple(sensors)
    for k, sensor in enumerate(listed):
        require_type(f"Rig: sensors[{k}]", sensor, Lidar, DepthCamera, HeightScan)
    return listed


def _as_seed(seed: object) -> int:
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"Rig: seed: got {seed!r}, expected a whole number from 0 to 2^63 - 1")
    return int(seed)


@dataclass(frozen=True, eq=False)
class _Mounted:
    """A sensor on a scene: its rays, on the device."""

    scene: Scene
    spec: Sensor
    mount: BoundMount
    pattern: Pattern
    fixed_rays: Rays
    ring: wp.array | None
    column: wp.array | None
    physics: LidarPhysics | None
    depth_physics: DepthPhysics | None
    frames: Iterator[int]

    @staticmethod
    def on(scene: Scene, spec: Sensor) -> "_Mounted":
        pattern = spec.pattern(scene.model)
        origins = np.zeros((1, 3)) if pattern.origins is None else pattern.origins

        copies = 2 if isinstance(spec, Lidar) and spec.returns == "dual" else 1
        has_packets = pattern.origins is None and scene.device.is_cpu
        packets = sort_into_packets(pattern.directions.reshape(-1, 3)) if has_packets else None
        rays = replace(scene.rays_in_frame(pattern.directions, origins, np.eye(4)), packets=packets)

        def upload(index: NDArray[np.int32] | None) -> wp.array | None:
            if index is None:
                return None
            every = index if copies == 1 else np.repeat(index[..., None], copies, axis=-1)
            return wp.array(every, dtype=int, device=scene.device)

        return _Mounted(
            scene,
            spec,
            spec.mount.bind(scene.model),
            pattern,
            rays,
            upload(pattern.ring),
            upload(pattern.column),
            LidarPhysics(scene, spec, rays) if isinstance(spec, Lidar) and spec.has_effects else None,
            DepthPhysics(scene, spec, pattern) if isinstance(spec, DepthCamera) and spec.has_effects else None,
            count(),
        )

    def pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """(4, 4) the sensor's frame in the world."""
        with np.errstate(invalid="ignore"):  # a pose with inf in it becomes NaN
            pose = self.mount.pose(data)
        if self.spec.yaw_aligned:
            pose = yaw_only(pose)
        pose[:3, :3] = pose[:3, :3] @ self.spec.frame_rotation
        return pose

    def visible(self) -> wp.array:
        return self.scene.visible(self.spec.filter)

    def rays(self, data: mujoco.MjData) -> Rays:
        return self.scene.in_pose(self.fixed_rays, self.pose(data))

    def world_rays(self, data: mujoco.MjData) -> WorldRays:
        pose = self.pose(data)
        directions = self.pattern.directions @ pose[:3, :3].T
        local = np.zeros(3) if self.pattern.origins is None else self.pattern.origins
        return WorldRays(np.broadcast_to(local @ pose[:3, :3].T + pose[:3, 3], directions.shape), directions)
