"""Mounts of sensors on a body, a site, a camera or the world, with an offset."""

from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from rigcast.sensors.faults import Fault, refuse
from rigcast.sensors.names import expected_one_of, model_names
from rigcast.sensors.rotations import rotation_matrix

from .spec import Numbers, Spec, Takes, optional

Parent = Literal["world", "body", "site", "camera"]
Alignment = Literal["base", "yaw", "world"]

CARRIERS: dict[Parent, tuple[str, str]] = {
    "body": ("xpos", "xmat"),
    "site": ("site_xpos", "site_xmat"),
    "camera": ("cam_xpos", "cam_xmat"),
}
"""Fields of MjData with the poses of a mount's parents."""

# A MuJoCo camera looks along its -z with +y up. Columns: the mount's forward, left and up in camera axes.
_CAMERA_FORWARD_LEFT_UP = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])


class Mount(Spec):
    """Where a sensor is mounted. It looks along the mount's +x with +z up (REP-103).

    With none of `body`, `site` and `camera` the sensor is fixed to the world. On an MJCF camera the mount's
    +x is where that camera looks and its +z is the camera's up, and the offset is applied in these axes.
    """

    body: str | None = Field(default=None, description="name of the MuJoCo body that carries the sensor")
    site: str | None = Field(default=None, description="name of the MuJoCo site that carries the sensor")
    camera: str | None = Field(default=None, description="name of the MJCF camera from which the sensor looks")
    pos: Takes[Numbers, tuple[float, float, float]] = optional(
        default=(0.0, 0.0, 0.0), description="offset x, y, z from the carrier [m]"
    )
    quat: Takes[Numbers | None, tuple[float, float, float, float] | None] = optional(
        default=None, description="orientation relative to the carrier, w, x, y, z; any length but zero"
    )
    euler_deg: Takes[Numbers | None, tuple[float, float, float] | None] = optional(
        default=None, description="orientation: roll, pitch, yaw about the fixed x, y, z axes [deg]"
    )

    @field_validator("quat")
    @classmethod
    def _not_zero(cls, quat: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if quat is not None and not 1e-9 < np.linalg.norm(quat) < np.inf:
            raise ValueError(f"must be w, x, y, z of a length that is not 0, got {list(quat)}")
        return quat

    @model_validator(mode="after")
    def _one_of_each(self) -> "Mount":
        carriers = [key for key in ("body", "site", "camera") if getattr(self, key) is not None]
        if len(carriers) > 1:
            raise ValueError(f"give at most one of body, site and camera, got {' and '.join(carriers)}")
        if self.quat is not None and self.euler_deg is not None:
            raise ValueError("give quat or euler_deg, got both")
        return self

    @property
    def parent(self) -> Parent:
        """The kind of object that carries the sensor."""
        if self.body is not None:
            return "body"
        if self.site is not None:
            return "site"
        return "camera" if self.camera is not None else "world"

    @property
    def offset(self) -> NDArray[np.float64]:
        """(4, 4) float64: the mount's frame in the carrier's."""
        offset = np.eye(4)
        offset[:3, 3] = self.pos
        if self.quat is not None:
            offset[:3, :3] = rotation_matrix(np.array(self.quat) / np.linalg.norm(self.quat))
        elif self.euler_deg is not None:
            offset[:3, :3] = _rotation_from_euler(np.deg2rad(self.euler_deg))
        return offset

    def faults(self, model: mujoco.MjModel) -> list[Fault]:
        """Faults that prevent use of this mount on `model`: a name that the model does not have."""
        if self.parent == "world" or self._id(model) >= 0:
            return []
        kind, count = _objects(model, self.parent)
        name = str(getattr(self, self.parent))
        others = [other for other in CARRIERS if mujoco.mj_name2id(model, _objects(model, other)[0], name) >= 0]
        but = f", but a {' and a '.join(others)}" if others else ""
        expected = expected_one_of(name, model_names(model, kind, count))
        return [Fault((self.parent,), f"no {self.parent} {name!r} in the model{but}, {expected}")]

    def bind(self, model: mujoco.MjModel) -> "BoundMount":
        """This mount on `model`. Raises InputError for a name that the model does not have."""
        refuse("Mount", self.faults(model))
        offset = self.offset
        if self.parent == "camera":
            offset[:3] = _CAMERA_FORWARD_LEFT_UP @ offset[:3]
        return BoundMount(self.parent, self._id(model), _body_of(model, self.parent, self._id(model)), offset)

    def _id(self, model: mujoco.MjModel) -> int:
        if self.parent == "world":
            return 0
        kind, _ = _objects(model, self.parent)
        return int(mujoco.mj_name2id(model, kind, getattr(self, self.parent)))


@dataclass(frozen=True, eq=False)
class BoundMount:
    """A mount on one model: `id` is the body's, site's or camera's, `body_id` the body that moves it.

    offset: (4, 4) float64, the mount's frame in the carrier's, for a camera in MuJoCo's axes.
    """

    parent: Parent
    id: int
    body_id: int
    offset: NDArray[np.float64]

    def turned(self, rotation: NDArray[np.float64]) -> "BoundMount":
        """A mount at the same place with other axes: the columns of `rotation` (3, 3) in this mount's frame."""
        offset = self.offset.copy()
        offset[:3, :3] = offset[:3, :3] @ rotation
        return replace(self, offset=offset)

    def pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """(4, 4) float64: the mount's frame, x forward and z up, in the world, as `data` has it.

        Bodies and sites need `mj_kinematics` to have run; cameras `mj_comPos` and `mj_camlight` too.
        """
        position, rotation = self.carriers(data)
        if position is None or rotation is None:
            return self.offset.copy()
        return placed(position[self.id], rotation[self.id].reshape(3, 3), self.offset)

    def carriers(self, data: mujoco.MjData) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """The positions (n, 3) and rotations (n, 9) of all objects of the parent's kind; None for the world."""
        if self.parent == "world":
            return None, None
        position, rotation = CARRIERS[self.parent]
        return getattr(data, position), getattr(data, rotation)


def placed(
    position: NDArray[np.float64], rotation: NDArray[np.float64], offset: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The pose (4, 4) of a frame at `offset` (4, 4) in a frame with this pose.

    Summed in the order of `rigcast.kernels.poses.mounts`, and not by BLAS, so that both have the same bits.
    """
    pose = np.eye(4)
    with np.errstate(invalid="ignore"):  # a pose that contains inf becomes NaN
        pose[:3] = rotation[:, :1] * offset[0] + rotation[:, 1:2] * offset[1] + rotation[:, 2:] * offset[2]
        pose[:3, 3] += position
    return pose


def aligned(pose: NDArray[np.float64], alignment: Alignment) -> NDArray[np.float64]:
    """A pose (4, 4) with its rotation, or of that only the yaw, or no rotation, as `rigcast.kernels.poses.mounts` does.

    The yaw is the heading of the x axis, atan2(R10, R00); it is 0 for an x axis that is exactly vertical.
    """
    if alignment == "base":
        return pose
    out = pose.copy()
    out[:3, :3] = _heading(pose) if alignment == "yaw" else np.eye(3)
    return out


def _heading(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation (3, 3) about z by the heading of the x axis, by square roots alone, for the kernel's bits."""
    x, y = pose[0, 0], pose[1, 0]
    with np.errstate(invalid="ignore"):
        length = np.sqrt(x * x + y * y)
        cosine, sine = (x / length, y / length) if length != 0 else (np.float64(1.0), np.float64(0.0))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _objects(model: mujoco.MjModel, parent: Parent) -> tuple[mujoco.mjtObj, int]:
    if parent == "site":
        return mujoco.mjtObj.mjOBJ_SITE, model.nsite
    if parent == "camera":
        return mujoco.mjtObj.mjOBJ_CAMERA, model.ncam
    return mujoco.mjtObj.mjOBJ_BODY, model.nbody


def _body_of(model: mujoco.MjModel, parent: Parent, index: int) -> int:
    if parent == "site":
        return int(model.site_bodyid[index])
    return int(model.cam_bodyid[index]) if parent == "camera" else index


def _rotation_from_euler(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Roll, pitch, yaw [rad] about fixed x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x
