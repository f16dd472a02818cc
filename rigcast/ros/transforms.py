"""The tree of ROS frames of a model and the sensors on it.

Every body is a frame in that of its parent, called by its name ("body_3" if it has none), MuJoCo's world by
`world_frame`. A sensor's `<name>_frame` is its mount, x forward and z up; a camera has `<name>_optical_frame` in it
(REP-103). Bodies without joints, and sensors on them, are static. A sensor that turns against its body (a height
scan may keep upright, an MJCF camera may track) is a frame in the world's.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.export.ids import IdTable
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.specs.mount import BoundMount
from rigcast.sensors.specs.sensor_spec import SensorSpec

Poses = dict[tuple[str, str], NDArray[np.float64]]
"""(4, 4) by (parent, child): the child's frame in the parent's."""


class TransformTree:
    """The transforms of a model with sensors, from MjData as it stands after `mj_step`.

    static: those that never change. frame_ids: the frame of each sensor's points, by its name.
    Raises InputError where a body and a sensor's frame would have one name.
    """

    def __init__(self, model: mujoco.MjModel, sensors: Sequence[SensorSpec], world_frame: str) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._names = [world_frame, *(name.lstrip("/") for name in IdTable.of(model).body_name[1:])]
        self._moving = [b for b in range(1, model.nbody) if model.body_jntnum[b] or model.body_mocapid[b] >= 0]
        self._freed = {spec.name for spec in sensors if _is_free(spec, model)}
        self.frame_ids = {spec.name: _frame_id(spec) for spec in sensors}
        self._refuse_shared_names()
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)
        mujoco.mj_camlight(model, self._data)
        self.static = self._fixed_bodies() | self._fixed_sensors(sensors)

    def moving(self, data: mujoco.MjData) -> Poses:
        """The transforms of bodies that move, at `data.time`; `data` is only read."""
        self._data.qpos[:] = data.qpos
        self._data.mocap_pos[:] = data.mocap_pos
        self._data.mocap_quat[:] = data.mocap_quat
        mujoco.mj_kinematics(self._model, self._data)
        return {self._link(body): self._relative(body) for body in self._moving}

    def of_frame(self, frame: Frame) -> Poses:
        """The transform of a frame's sensor where that is not static: in the world, at the frame's time."""
        if frame.sensor not in self._freed:
            return {}
        return {(self._names[0], self.frame_ids[frame.sensor]): frame.pose}

    def _fixed_bodies(self) -> Poses:
        moving = set(self._moving)
        return {self._link(b): self._relative(b) for b in range(1, self._model.nbody) if b not in moving}

    def _fixed_sensors(self, sensors: Sequence[SensorSpec]) -> Poses:
        poses: Poses = {}
        for spec in sensors:
            if spec.name in self._freed:
                continue
            mount = spec.mount.bind(self._model)
            link = (self._names[mount.body_id], f"{spec.name}_frame")
            poses[link] = _inverse(self._pose(mount.body_id)) @ mount.pose(self._data)
            if spec.frame_rotation is not SensorSpec.frame_rotation:
                optical = np.eye(4)
                optical[:3, :3] = spec.frame_rotation
                poses[f"{spec.name}_frame", self.frame_ids[spec.name]] = optical
        return poses

    def _link(self, body: int) -> tuple[str, str]:
        return self._names[self._model.body_parentid[body]], self._names[body]

    def _relative(self, body: int) -> NDArray[np.float64]:
        return _inverse(self._pose(self._model.body_parentid[body])) @ self._pose(body)

    def _pose(self, body: int) -> NDArray[np.float64]:
        return BoundMount("body", body, body, np.eye(4)).pose(self._data)

    def _refuse_shared_names(self) -> None:
        frames = {f"{name}_frame" for name in self.frame_ids} | set(self.frame_ids.values())
        shared = sorted(frames.intersection(self._names)) + sorted(
            {name for name in self._names[1:] if name == self._names[0]}
        )
        if shared:
            raise InputError(
                f"ROS frames: {', '.join(map(repr, shared))} is the name of a body too, expected another name of the "
                "sensor, or another world_frame"
            )


def _is_free(spec: SensorSpec, model: mujoco.MjModel) -> bool:
    """Whether a sensor rotates relative to its body."""
    if spec.frame_alignment != "base":
        return True
    fixed = mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    return spec.mount.parent == "camera" and model.cam_mode[spec.mount.bind(model).id] != fixed


def _frame_id(spec: SensorSpec) -> str:
    optical = spec.frame_rotation is not SensorSpec.frame_rotation
    return f"{spec.name}_optical_frame" if optical else f"{spec.name}_frame"


def _inverse(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse
