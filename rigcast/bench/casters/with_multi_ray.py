"""MuJoCo's `mj_multiRay`, which culls by bounding boxes of bodies where `mj_ray` tries every geom."""

from collections.abc import Sequence

import mujoco
import numpy as np

from .caster import EVERY_GROUP, Answer, Cast, Floats


class MultiRay:
    name = "mj_multiRay"
    version = mujoco.__version__

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int] = EVERY_GROUP) -> None:
        self._model, self._data = model, data
        self._groups = np.isin(EVERY_GROUP, groups).astype(np.uint8)

    def aim(self, origins: Floats, directions: Floats) -> Cast:
        """All rays in one call, or one ray per call: the rays of a call share their origin."""
        count = len(directions)
        starts = origins.reshape(-1, 3)
        rays = np.array_split(np.ascontiguousarray(directions), len(starts))
        distance, normal = np.empty(count), np.empty((count, 3))
        geom_id = np.empty(count, np.int32)
        outs = [np.array_split(out, len(starts)) for out in (geom_id, distance, normal)]

        def frame() -> Answer:
            for start, towards, ids, t, n in zip(starts, rays, *outs, strict=True):
                seen = self._groups, True, -1  # static geoms, no body excluded
                out = ids, t, n.ravel(), len(towards), mujoco.mjMAXVAL
                mujoco.mj_multiRay(self._model, self._data, start, towards.ravel(), *seen, *out)
            return Answer(np.where(geom_id < 0, np.inf, distance), geom_id, normal)

        return frame


CASTER = MultiRay
