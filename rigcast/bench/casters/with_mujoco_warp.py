"""mujoco_warp's `rays` with its BVH, on the CPU."""

import copy
from collections.abc import Sequence
from importlib.metadata import version

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from mujoco_warp._src.types import vec6

from .caster import EVERY_GROUP, Answer, Cast, Floats


class Rays:
    """mujoco_warp's `rays` of origins and directions (nworld, n, 3) in the world, into the same arrays each time."""

    def __init__(self, origins: Floats, directions: Floats) -> None:
        shape = directions.shape[:2]
        self._rays = [wp.array(part.astype(np.float32), dtype=wp.vec3) for part in (origins, directions)]
        self._seen = vec6(*[-1.0] * 6), True, wp.full(shape[1], -1, dtype=int)
        self._out = wp.empty(shape, dtype=float), wp.empty(shape, dtype=int), wp.empty(shape, dtype=wp.vec3)

    def cast(self, model: mjw.Model, state: mjw.Data, context: mjw.RenderContext) -> None:
        """Cast against the BVH of the context as it stands."""
        mjw.rays(model, state, *self._rays, *self._seen, *self._out, context)

    def answer(self) -> Answer:
        """Hits of the last cast, world after world."""
        distance, geom_id, normal = (out.numpy() for out in self._out)
        missed = geom_id.ravel() < 0
        normals = np.where(missed[:, None], 0.0, normal.reshape(-1, 3))
        return Answer(np.where(missed, np.inf, distance.ravel()), geom_id.ravel(), normals)


class MujocoWarp:
    name = "mujoco_warp"
    version = version("mujoco-warp")

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int] = EVERY_GROUP) -> None:
        self._data = data
        with wp.ScopedDevice("cpu"):
            self._model, self._state = mjw.put_model(model), mjw.put_data(model, copy.copy(data))
            self._update()
            self._context = mjw.create_render_context(model, enabled_geom_groups=list(groups))

    def aim(self, origins: Floats, directions: Floats) -> Cast:
        with wp.ScopedDevice("cpu"):
            rays = Rays(np.broadcast_to(origins, directions.shape)[None], directions[None])

        def frame() -> Answer:
            with wp.ScopedDevice("cpu"):
                self._update()
                mjw.refit_bvh(self._model, self._state, self._context)
                rays.cast(self._model, self._state, self._context)
            return rays.answer()

        return frame

    def _update(self) -> None:
        # put_data runs mj_kinematics, which would undo poses that were moved by hand
        self._state.geom_xpos.assign(self._data.geom_xpos[None].astype(np.float32))
        self._state.geom_xmat.assign(self._data.geom_xmat.reshape(1, -1, 3, 3).astype(np.float32))


CASTER = MujocoWarp
