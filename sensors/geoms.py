"""The geoms of a model as a part of a scene."""

import warnings

import mujoco
import numpy as np
from numpy.typing import NDArray

from .filter import Filter
from .model_geometry import read_model
from .part import Owner, Snapshot


class Geoms:
    """Shape k is geom k; poses are taken as they stand in the data, as `mj_ray` does."""

    owner: Owner = "geom"

    def __init__(self, model: mujoco.MjModel) -> None:
        geometry = read_model(model)
        self.model = model
        self.trees = geometry.trees
        self.shapes = geometry.shapes
        self.ids = np.arange(model.ngeom, dtype=np.int32)
        self.bodies = model.geom_bodyid.astype(np.int32)
        self._supported = geometry.supported
        self._lost: set[int] = set()

    def update(self, data: mujoco.MjData) -> Snapshot:
        is_finite = np.isfinite(data.geom_xpos).all(axis=1) & np.isfinite(data.geom_xmat).all(axis=1)
        self._warn_of_lost(data.time, is_finite)
        # an infinite plane would be hit even where one of its in-plane axes is NaN
        return Snapshot(np.where(is_finite[:, None], data.geom_xpos, np.nan), data.geom_xmat)

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        return filter.visible(self.model) & self._supported

    def _warn_of_lost(self, time: float, is_finite: NDArray[np.bool_]) -> None:
        lost = set(np.flatnonzero(~is_finite).tolist())
        new = sorted(lost - self._lost)
        self._lost = lost
        if new:
            names = ", ".join(self.model.geom(g).name or f"geom {g}" for g in new[:10])
            more = f" and {len(new) - 10} more" if len(new) > 10 else ""
            message = f"pose not finite at t = {time:g} s, not hit: {names}{more}"
            warnings.warn(message, RuntimeWarning, stacklevel=4)
