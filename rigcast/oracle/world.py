"""All objects that rays can hit in one state of a model, each kind cast by MuJoCo's own function."""

import copy
from collections.abc import Sequence
from typing import Protocol

import mujoco
import numpy as np

from rigcast.oracle import deformable
from rigcast.oracle.props import props_oracle
from rigcast.oracle.ray import Floats, Ints, Oracle, RayHits, require_answerable
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop


class _Part(Protocol):
    """Objects of one kind, numbered from 0."""

    count: int

    def cast(self, origins: Floats, directions: Floats) -> RayHits: ...

    def cast_at(self, origins: Floats, directions: Floats, ids: Ints, normals: Floats | None) -> RayHits: ...


class World:
    """Geoms by `mj_ray`, flexes by `mj_rayFlex`, skins by `mju_raySkin`, props by `mj_ray` on their meshes.

    An SDF geom that has a mesh counts as a mesh geom with this mesh: that is what rigcast casts against (docs/sdf.md).
    `RayHits.geom_id` counts on from geoms to flexes, skins and props, as in `Things`. Flexes and skins are left out
    where the installed MuJoCo cannot say what rays hit of them, `deformable.CAN_JUDGE`.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, filter: Filter | None = None, props: Sequence[Prop] = ()
    ) -> None:
        require_answerable(model, data, filter)
        filter = filter or Filter()
        self._parts: dict[int, _Part] = {0: Oracle(_with_meshes_for_sdf(model), data, filter)}
        if model.nflex and deformable.CAN_JUDGE:
            self._parts[model.ngeom] = deformable.Flexes(model, data, filter)
        if model.nskin and deformable.CAN_JUDGE:
            self._parts[model.ngeom + model.nflex] = deformable.Skins(model, data, filter)
        if props:
            self._parts[model.ngeom + model.nflex + model.nskin] = props_oracle(model, data, filter, props)
        self.count = model.ngeom + model.nflex + model.nskin + len(props)

    def cast(self, origins: Floats, directions: Floats) -> RayHits:
        """Return what rays, (n, 3) origins [m] and unit directions in the world frame, hit first."""
        first = RayHits.misses(len(origins))
        for start, part in self._parts.items():
            hits = part.cast(origins, directions)
            nearer = hits.distance < first.distance
            first.put(nearer, _renumbered(hits.take(nearer), start))
        return first

    def cast_at(self, origins: Floats, directions: Floats, ids: Ints, normals: Floats) -> RayHits:
        """Return what each ray hits when the thing `ids` (n,) is all that it could hit.

        Where two faces of a flex or skin lie in one place, it is the one whose normal is next to `normals` (n, 3).
        """
        hits = RayHits.misses(len(ids))
        for start, part in self._parts.items():
            rays = np.flatnonzero((ids >= start) & (ids < start + part.count))
            if rays.size:
                found = part.cast_at(origins[rays], directions[rays], ids[rays] - np.int32(start), normals[rays])
                hits.put(rays, _renumbered(found, start))
        return hits


def _renumbered(hits: RayHits, start: int) -> RayHits:
    return hits._replace(geom_id=np.where(hits.geom_id >= 0, hits.geom_id + start, -1).astype(np.int32))


def _with_meshes_for_sdf(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model itself, or a copy in which SDF geoms with a mesh are mesh geoms."""
    sdf = (model.geom_type == mujoco.mjtGeom.mjGEOM_SDF) & (model.geom_dataid >= 0)
    if not sdf.any():
        return model
    private = copy.copy(model)
    private.geom_type[sdf] = mujoco.mjtGeom.mjGEOM_MESH
    return private
