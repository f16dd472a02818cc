"""Casts of scenes, each judged by mj_ray."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from rigcast import Filter, Scene
from rigcast.oracle import Comparison, Verdict, compare

Placed = tuple[mujoco.MjModel, mujoco.MjData, Scene]


def placed(model: mujoco.MjModel) -> Placed:
    """A model, its initial state, and a scene in that."""
    data, scene = mujoco.MjData(model), Scene(model)
    mujoco.mj_kinematics(model, data)
    scene.update(data)
    return model, data, scene


def assert_none_wrong(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    origins: ArrayLike,
    directions: ArrayLike,
    hits: Any,
    filter: Filter | None = None,
    what: str = "cast",
) -> Comparison:
    """mj_ray agrees with every hit. what: begins the message, which has the first wrong ray and both answers."""
    found = compare(model, data, origins, directions, hits, filter)
    wrong = found.where(Verdict.WRONG)
    if wrong.size:
        ray, towards = wrong[:1], np.asarray(directions)
        starts = np.broadcast_to(np.asarray(origins), towards.shape).reshape(-1, 3)
        raise AssertionError(
            f"{what}: {wrong.size} wrong of {len(starts)} rays, first ray {ray[0]}: "
            f"origin {starts[ray[0]].tolist()}, direction {towards.reshape(-1, 3)[ray[0]].tolist()}\n"
            f"got {found.got.take(ray)}\nexpected {found.expected.take(ray)}"
        )
    return found
