"""MuJoCo's `mj_multiRay`, which culls by bounding boxes of bodies where `mj_ray` tries every geom."""

import mujoco
import numpy as np

from peers.answer import Answer, Caster, Floats


def cast(model: mujoco.MjModel, data: mujoco.MjData, origins: Floats, directions: Floats) -> Answer:
    """Cast one ray per call: the rays of one call share their origin."""
    distance, normal = np.empty(len(origins)), np.empty((len(origins), 3))
    geom_id = np.empty(len(origins), np.int32)
    every = (None, True, -1)  # groups, static geoms, no body excluded
    for i, (start, towards) in enumerate(zip(origins, directions, strict=True)):
        out = geom_id[i : i + 1], distance[i : i + 1], normal[i]
        mujoco.mj_multiRay(model, data, start, towards, *every, *out, 1, mujoco.mjMAXVAL)
    distance[geom_id < 0] = np.inf
    return Answer(distance, geom_id, normal)


CASTER = Caster("mj_multiRay", mujoco.__version__, cast)
