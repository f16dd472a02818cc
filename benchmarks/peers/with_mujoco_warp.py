"""mujoco_warp's `rays` with its BVH, on the CPU."""

import copy
import importlib.metadata

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from mujoco_warp._src.types import vec6

from peers.answer import Answer, Caster, Floats


def cast(model: mujoco.MjModel, data: mujoco.MjData, origins: Floats, directions: Floats) -> Answer:
    """Cast all rays in one call, geoms of every group enabled."""
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(model), mjw.put_data(model, copy.copy(data))
        # put_data runs mj_kinematics, which undoes poses that were moved by hand
        d.geom_xpos.assign(data.geom_xpos[None].astype(np.float32))
        context = mjw.create_render_context(model, enabled_geom_groups=list(range(6)))
        mjw.refit_bvh(m, d, context)
        count = len(origins)
        start, towards = (wp.array(part.reshape(1, -1, 3), dtype=wp.vec3) for part in (origins, directions))
        excluded = wp.full(count, -1, dtype=int)
        distance, geom_id = wp.empty((1, count), dtype=float), wp.empty((1, count), dtype=int)
        normal = wp.empty((1, count), dtype=wp.vec3)
        mjw.rays(m, d, start, towards, vec6(*[-1.0] * 6), True, excluded, distance, geom_id, normal, context)
        t, ids, normals = distance.numpy()[0].astype(float), geom_id.numpy()[0], normal.numpy()[0].astype(float)
    return Answer(np.where(ids < 0, np.inf, t), ids, np.where(ids[:, None] < 0, 0.0, normals))


CASTER = Caster("mujoco_warp", importlib.metadata.version("mujoco-warp"), cast)
