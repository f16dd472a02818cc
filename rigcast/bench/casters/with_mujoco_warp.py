"""mujoco_warp's `rays` with its BVH, on the CPU."""

import copy
from collections.abc import Sequence
from importlib.metadata import version

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from mujoco_warp._src.types import vec6

from .caster import EVERY_GROUP, Answer, Floats, Frame


class MujocoWarp:
    name = "mujoco_warp"
    version = version("mujoco-warp")

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int] = EVERY_GROUP) -> None:
        self._data = data
        with wp.ScopedDevice("cpu"):
            self._model, self._state = mjw.put_model(model), mjw.put_data(model, copy.copy(data))
            self._update()
            self._context = mjw.create_render_context(model, enabled_geom_groups=list(groups))

    def aim(self, origins: Floats, directions: Floats) -> Frame:
        count = len(directions)
        starts = np.broadcast_to(origins, directions.shape)
        with wp.ScopedDevice("cpu"):
            rays = [wp.array(part.reshape(1, -1, 3), dtype=wp.vec3) for part in (starts, directions)]
            excluded = wp.full(count, -1, dtype=int)
            distance, geom_id = wp.empty((1, count), dtype=float), wp.empty((1, count), dtype=int)
            normal = wp.empty((1, count), dtype=wp.vec3)

        def frame() -> Answer:
            with wp.ScopedDevice("cpu"):
                self._update()
                mjw.refit_bvh(self._model, self._state, self._context)
                seen = vec6(*[-1.0] * 6), True, excluded
                mjw.rays(self._model, self._state, *rays, *seen, distance, geom_id, normal, self._context)
            t, ids, normals = (out.numpy()[0] for out in (distance, geom_id, normal))
            missed = ids < 0
            return Answer(np.where(missed, np.inf, t), ids, np.where(missed[:, None], 0.0, normals))

        return frame

    def _update(self) -> None:
        # put_data runs mj_kinematics, which would undo poses that were moved by hand
        self._state.geom_xpos.assign(self._data.geom_xpos[None].astype(np.float32))
        self._state.geom_xmat.assign(self._data.geom_xmat.reshape(1, -1, 3, 3).astype(np.float32))


CASTER = MujocoWarp
