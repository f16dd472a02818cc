"""Random draws for an episode: numbers of the rig and poses of bodies. Each depends on the seed and a name only."""

from collections.abc import Mapping

import mujoco
import numpy as np

from rigcast.dataset.description.file import PoseRange, Randomise
from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of, model_names
from rigcast.sensors.rig.timing.schedule import uniform


def draw_rig(randomise: Randomise, seed: int) -> dict[str, float]:
    """Values for the rig by key, each uniform within its range."""
    return {key: low + (high - low) * uniform((seed, f"rig {key}"), 0, 0) for key, (low, high) in randomise.rig.items()}


def draw_poses(randomise: Randomise, seed: int) -> dict[str, list[float]]:
    """Displacements by body name: x, y, z [m] and angles about fixed x, y, z [deg]."""
    return {name: _offset(name, limits, seed) for name, limits in randomise.poses.items()}


def place_bodies(model: mujoco.MjModel, data: mujoco.MjData, offsets: Mapping[str, list[float]]) -> None:
    """Move bodies: those with a free joint or mocap bodies in `data`, others in `model`, before a rig is built on it.

    Raises InputError for a body that the model does not have.
    """
    for name, offset in offsets.items():
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
        if body <= 0:
            names = model_names(model, mujoco.mjtObj.mjOBJ_BODY, model.nbody)[1:]
            raise InputError(f"randomise.poses: no body {name!r} that can be moved, {expected_one_of(name, names)}")
        pos, quat = _pose_of(model, data, body)
        pos += offset[:3]
        turn = np.zeros(4)
        mujoco.mju_euler2Quat(turn, np.deg2rad(offset[3:]), "XYZ")  # capital letters: about fixed axes
        mujoco.mju_mulQuat(quat, turn, quat.copy())


def of_free_bodies(model: mujoco.MjModel, offsets: Mapping[str, list[float]]) -> dict[str, list[float]]:
    """The displacements of bodies with a free joint, whose poses are in `qpos`."""
    return {name: offset for name, offset in offsets.items() if _is_free(model, model.body(name).id)}


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    joint = model.body_jntadr[body]
    return bool(joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)


def _offset(name: str, limits: PoseRange, seed: int) -> list[float]:
    most = (*limits.pos, *limits.euler_deg)
    return [limit * (2 * uniform((seed, f"pose {name}"), 0, k) - 1) for k, limit in enumerate(most)]


def _pose_of(
    model: mujoco.MjModel, data: mujoco.MjData, body: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Views of a body's position (3,) and quaternion (4,), wherever MuJoCo keeps them."""
    mocap = model.body_mocapid[body]
    if mocap >= 0:
        return data.mocap_pos[mocap], data.mocap_quat[mocap]
    if _is_free(model, body):
        address = model.jnt_qposadr[model.body_jntadr[body]]
        return data.qpos[address : address + 3], data.qpos[address + 3 : address + 7]
    return model.body_pos[body], model.body_quat[body]
