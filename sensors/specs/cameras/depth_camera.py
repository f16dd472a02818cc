"""Depth cameras: one ray through the centre of each pixel, through a lens or a pinhole."""

from typing import Annotated, ClassVar, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from rigcast.sensors.faults import Fault, refuse
from rigcast.sensors.specs.lens import AnyLens, BrownConrady, Lens
from rigcast.sensors.specs.mount import BoundMount
from rigcast.sensors.specs.pattern import Pattern, refuse_too_many
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.spec import Integers, Keys, Takes, optional

from .ranging import Stereo, TimeOfFlight

Pixels = Annotated[int, Field(ge=1)]
# Within these limits, far beyond any real lens, no ray's length overflows: |(u - cx) / fx| < 2e15.
Focal = Annotated[float, Field(ge=1e-6)]
Principal = Annotated[float, Field(ge=-1e9, le=1e9)]
_FOCAL = ("fx", "fy", "cx", "cy")
_VIEW = ("fov_x_deg", "fov_y_deg")

# Columns: the optical frame's right, down and forward in the mount's axes (x forward, y left, z up).
_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_OPTICAL.setflags(write=False)


class DepthCamera(SensorSpec):
    """A depth camera. Readings have shape (height, width).

    The optics are given by `fov_x_deg` or `fov_y_deg`, or by `fx`, `fy`, `cx` and `cy`. Without them, a camera on an
    MJCF camera has that camera's optics as MuJoCo renders it. Without `distortion` pixel (u, v) looks along
    ((u + 0.5 - cx) / fx, (v + 0.5 - cy) / fy, 1) in the ROS optical frame: z forward, x right, y down. With
    `distortion` this is where the lens images the pixel's ray. OpenCV puts the centre of pixel (u, v) at (u, v): add
    0.5 to its cx and cy.

    With a `readout_time` t (rolling shutter) row i of n is seen at i t / n after the first, with the camera and geoms
    where they are at that time. Points and depths are in the camera's frame at that time.

    `min_range` and `max_range` limit the distance along the ray, not the depth; with `stereo` or `time_of_flight` they
    limit what is measured.

    >>> DepthCamera(name="front", mount=Mount(camera="head"), resolution=(640, 480), fov_y_deg=58)
    """

    frame_rotation: ClassVar[NDArray[np.float64]] = _OPTICAL
    _alternatives: ClassVar[tuple[frozenset[str], ...]] = (*(frozenset({key}) for key in _VIEW), frozenset(_FOCAL))

    type: Literal["depth_camera"] = "depth_camera"
    resolution: Takes[Integers | None, tuple[Pixels, Pixels] | None] = optional(
        default=None, description="width and height [pixels]; null: those of the MJCF camera it is mounted on"
    )
    fov_x_deg: float | None = Field(
        default=None, gt=0, lt=180, description="horizontal field of view [deg]; square pixels, centred image"
    )
    fov_y_deg: float | None = Field(
        default=None, gt=0, lt=180, description="vertical field of view [deg]; square pixels, centred image"
    )
    fx: Focal | None = Field(default=None, description="horizontal focal length [pixels]")
    fy: Focal | None = Field(default=None, description="vertical focal length [pixels]")
    cx: Principal | None = Field(default=None, description="principal point from the image's left edge [pixels]")
    cy: Principal | None = Field(default=None, description="principal point from the image's top edge [pixels]")

    distortion: Takes[AnyLens | Keys | None, AnyLens | None] = optional(
        default=None, description="lens distortion, with fx, fy, cx and cy or those of the MJCF camera; null: pinhole"
    )
    stereo: Takes[Stereo | Keys | None, Stereo | None] = optional(
        default=None, description="measure by stereo or structured light, with its errors"
    )
    time_of_flight: Takes[TimeOfFlight | Keys | None, TimeOfFlight | None] = optional(
        default=None, description="measure by time of flight, with its errors"
    )
    readout_time: float = Field(
        default=0.0,
        ge=0,
        description="rolling shutter: time from the first row to one past the last [s]; 0: all rows at once",
    )
    depth_scale: float = Field(default=0.001, gt=0, description="depth of one step of the 16-bit depth image [m]")

    @property
    def moves(self) -> bool:
        """Whether its rows are read one after the other (rolling shutter)."""
        return self.readout_time > 0

    @property
    def has_effects(self) -> bool:
        """Whether its readings have measurement effects."""
        return self.stereo is not None or self.time_of_flight is not None

    @property
    def takes_optics(self) -> bool:
        """Whether it uses the optics of the MJCF camera on which it is mounted."""
        return all(getattr(self, key) is None for key in (*_VIEW, *_FOCAL))  # mounted elsewhere, it has some

    @field_validator("resolution")
    @classmethod
    def _not_too_many(cls, resolution: tuple[int, int] | None) -> tuple[int, int] | None:
        if resolution is not None:
            refuse_too_many(resolution[0] * resolution[1])
        return resolution

    @model_validator(mode="after")
    def _read_in_time(self) -> "DepthCamera":
        if self.rate_hz is not None and self.readout_time * self.rate_hz > 1 + 1e-9:
            raise ValueError(
                f"readout_time: must be at most 1 / rate_hz, {1 / self.rate_hz:g} s, got {self.readout_time:g} s"
            )
        return self

    @model_validator(mode="after")
    def _one_principle(self) -> "DepthCamera":
        if self.stereo is not None and self.time_of_flight is not None:
            raise ValueError("give stereo or time_of_flight, got both")
        return self

    @model_validator(mode="after")
    def _one_kind_of_optics(self) -> "DepthCamera":
        view, given = ([key for key in keys if getattr(self, key) is not None] for keys in (_VIEW, _FOCAL))
        if len(view) + bool(given) > 1:
            got = ", ".join([*view, *given])
            raise ValueError(f"give one of fov_x_deg, fov_y_deg, and fx, fy, cx and cy, got {got}")
        if given and len(given) < len(_FOCAL):
            raise ValueError(f"give all of fx, fy, cx and cy, got only {', '.join(given)}")
        if self.distortion is not None and view:
            raise ValueError(f"fx, fy, cx and cy required with distortion, got {view[0]}")
        if self.mount.camera is None and not given and not view:
            raise ValueError("fov_x_deg or fov_y_deg, or fx, fy, cx and cy, required unless mounted on an MJCF camera")
        if self.mount.camera is None and self.resolution is None:
            raise ValueError("resolution required unless mounted on an MJCF camera")
        return self

    def faults(self, model: mujoco.MjModel) -> list[Fault]:
        """The faults of every sensor, and those of an MJCF camera without the resolution or optics that are needed.

        A lens that folds within the image is a fault, too.
        """
        faults = super().faults(model)
        if not faults and self.mount.camera is not None:
            faults = self._camera_faults(model, self.mount.bind(model).id)
        if faults or not isinstance(self.distortion, BrownConrady):
            return faults
        return _fold_faults(self._pattern(model).directions)

    def _camera_faults(self, model: mujoco.MjModel, camera: int) -> list[Fault]:
        faults = []
        if self.resolution is None and model.cam_resolution[camera].min() <= 1:
            faults.append(Fault((), f"resolution required: camera {self.mount.camera!r} of the model has none"))
        if self.takes_optics and model.cam_projection[camera] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC:
            faults.append(
                Fault(
                    ("mount", "camera"),
                    f"camera {self.mount.camera!r} of the model is orthographic, expected a perspective one, "
                    "or fov_x_deg or fov_y_deg, or fx, fy, cx and cy",
                )
            )
        return faults

    def pattern(self, model: mujoco.MjModel) -> Pattern:
        """Unit directions (height, width, 3) in the optical frame, with intrinsics and lens.

        Pixels that a Kannala-Brandt lens leaves dark are NaN. Raises InputError if `faults` finds any.
        """
        refuse(f"DepthCamera {self.name!r}", self.faults(model))
        return self._pattern(model)

    def _pattern(self, model: mujoco.MjModel) -> Pattern:
        width, height = self._resolution(self.mount.bind(model), model)
        intrinsics = self._intrinsics(self.mount.bind(model), model, width, height)
        subrays = 1 if self.time_of_flight is None else self.time_of_flight.subrays
        return Pattern(
            pixel_rays(intrinsics, self.distortion, width, height, 1)[..., 0, :],
            firing_times=self._row_times(width, height),
            intrinsics=intrinsics,
            lens=self.distortion,
            subrays=None if subrays == 1 else pixel_rays(intrinsics, self.distortion, width, height, subrays),
        )

    def _row_times(self, width: int, height: int) -> NDArray[np.float64] | None:
        """The time (height, width) [s] at which each pixel is read after the first; None if all are read at once."""
        if not self.moves:
            return None
        return np.repeat(self.readout_time / height * np.arange(height)[:, None], width, axis=1)

    def _resolution(self, mount: BoundMount, model: mujoco.MjModel) -> tuple[int, int]:
        if self.resolution is not None:
            return self.resolution
        width, height = model.cam_resolution[mount.id]
        return int(width), int(height)

    def _intrinsics(self, mount: BoundMount, model: mujoco.MjModel, width: int, height: int) -> NDArray[np.float64]:
        if self.fov_x_deg is not None:
            return _centred(_focal_length(self.fov_x_deg, width), width, height)
        if self.fov_y_deg is not None:
            return _centred(_focal_length(self.fov_y_deg, height), width, height)
        if self.fx is not None:
            return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)
        if model.cam_sensorsize[mount.id].all():
            return _from_sensor(model, mount.id, width, height)
        return _centred(_focal_length(float(model.cam_fovy[mount.id]), height), width, height)


def pixel_rays(
    intrinsics: NDArray[np.float64], lens: Lens | None, width: int, height: int, subrays: int
) -> NDArray[np.float64]:
    """Unit directions (height, width, subrays^2, 3) through the centres of each pixel's equal parts; NaN for no ray."""
    parts = (np.arange(subrays) + 0.5) / subrays
    across = (np.add.outer(np.arange(width), parts) - intrinsics[0, 2]) / intrinsics[0, 0]
    down = (np.add.outer(np.arange(height), parts) - intrinsics[1, 2]) / intrinsics[1, 1]
    x, y = across[:, None, :], down[:, None, :, None]
    if lens is not None:
        points = np.stack(np.broadcast_arrays(x, y), axis=-1)
        return lens.undistort(points.reshape(height, width, -1, 2))
    directions = np.empty((height, width, subrays, subrays, 3))
    length = np.sqrt(x * x + y * y + 1)
    for k, part in enumerate((x, y, 1)):
        np.divide(part, length, out=directions[..., k])
    return directions.reshape(height, width, -1, 3)


def _fold_faults(directions: NDArray[np.float64]) -> list[Fault]:
    """A fault for pixels whose direction, of (height, width, 3), is NaN because no ray is imaged there."""
    dark = np.isnan(directions[..., 2])
    if not dark.any():
        return []
    v, u = np.argwhere(dark)[0]
    message = f"folds within the image: no ray is seen at pixel ({u}, {v}), nor at {dark.sum() - 1} others"
    return [Fault(("distortion",), f"{message}; expected coefficients that hold over the whole image")]


def _focal_length(fov_deg: float, pixels: int) -> float:
    """Focal length f = (n / 2) / tan(fov / 2) [pixels], where n pixels span the field of view."""
    return float(0.5 * pixels / np.tan(np.deg2rad(fov_deg) / 2))


def _centred(focal: float, width: int, height: int) -> NDArray[np.float64]:
    """Intrinsics (3, 3) with square pixels and a centred principal point."""
    return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])


def _from_sensor(model: mujoco.MjModel, camera: int, width: int, height: int) -> NDArray[np.float64]:
    """The intrinsics of an MJCF camera with a sensor size, spread over width x height pixels.

    Read from the frustum with which MuJoCo renders that camera, not from `cam_intrinsic`: MuJoCo 3.6
    turned the sign with which the vertical principal point enters. The frustum bounds the image on the plane
    at distance `near`; `frustum_width` is half of its width.
    """
    view = mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
    scene = mujoco.MjvScene(model, 1)
    mujoco.mjv_updateCamera(model, mujoco.MjData(model), view, scene)
    frustum = scene.camera[0]
    per_width = width / (2 * frustum.frustum_width)
    per_height = height / (frustum.frustum_top - frustum.frustum_bottom)
    fx, fy = frustum.frustum_near * per_width, frustum.frustum_near * per_height
    cx, cy = (frustum.frustum_width - frustum.frustum_center) * per_width, frustum.frustum_top * per_height
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
