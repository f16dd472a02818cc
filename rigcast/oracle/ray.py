"""`mj_ray`, ray by ray in float64: MuJoCo's own hits."""

import copy
import functools
from types import NoneType
from typing import Any, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.faults import refuse
from rigcast.sensors.scene.same_model import require_posed
from rigcast.sensors.specs.filter import Filter

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]


class RayHits(NamedTuple):
    """Hits of n rays: distance (n,) [m], geom_id (n,), outward unit normal (n, 3). A miss is +inf, -1, 0.

    If flexes, skins or props are judged, too, `geom_id` continues beyond the geoms: see `Things`.
    """

    distance: Floats
    geom_id: Ints
    normal: Floats

    @classmethod
    def of(cls, hits: Any) -> "RayHits":
        """Return a caster's answer, such as `Hits.numpy()`, in float64, flat, in C order."""
        distance = np.asarray(hits.distance, np.float64).reshape(-1)
        geom_id = np.asarray(hits.geom_id, np.int32).reshape(-1)
        return cls(distance, geom_id, np.asarray(hits.normal, np.float64).reshape(-1, 3))

    @classmethod
    def misses(cls, count: int) -> "RayHits":
        return cls(np.full(count, np.inf), np.full(count, -1, np.int32), np.zeros((count, 3)))

    def take(self, rays: Any) -> "RayHits":
        """Return the hits of some of the rays, by index, slice or mask."""
        return RayHits(self.distance[rays], self.geom_id[rays], self.normal[rays])

    def put(self, rays: Any, hits: "RayHits") -> None:
        """Overwrite the hits of some of the rays, by index, slice or mask."""
        self.distance[rays], self.geom_id[rays], self.normal[rays] = hits


class Oracle:
    """mj_ray over the geoms of a model in the poses of `data` as they stand, seeing what a filter lets it see.

    Groups, static geoms and one excluded body are mj_ray's own arguments. What they cannot say (several
    bodies, subtrees, visual or collision geometry) is hidden in a private copy of the model, as alpha 0
    without a material. Raises InputError for data of another model or without poses, and for unknown bodies.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, filter: Filter | None = None) -> None:
        require_answerable(model, data, filter)
        filter = filter or Filter()
        bodies = _excluded_bodies(model, filter)
        self.count = int(model.ngeom)
        self.data = data
        self.groups = _group_flags(filter)
        self.static = filter.static
        self.body = bodies.pop() if len(bodies) == 1 else -1
        self.model = _with_hidden(model, _unsayable(model, filter, bodies))

    def cast(self, origins: npt.ArrayLike, directions: npt.ArrayLike) -> RayHits:
        """Return what rays in the world frame hit.

        origins (3,) or (..., 3) [m]; directions (..., 3), any non-zero length. The answer is flat, in C
        order. Raises InputError for a zero or non-finite direction, which would end the process inside
        mj_ray.
        """
        starts, unit = flat_rays(origins, directions)
        distance = np.empty(len(unit))
        geom_id = np.empty(len(unit), np.int32)
        normal = np.empty((len(unit), 3))
        ray, (model, data), seen = mujoco.mj_ray, (self.model, self.data), (self.groups, self.static, self.body)
        for i, (start, direction) in enumerate(zip(starts, unit, strict=True)):
            distance[i] = ray(model, data, start, direction, *seen, geom_id[i : i + 1], normal[i])
        distance[geom_id < 0] = np.inf
        return RayHits(distance, geom_id, normal)

    @functools.cached_property
    def _one_by_one(self) -> "Oracle":
        """This oracle with all geoms hidden."""
        only = copy.copy(self)
        only.model = _with_hidden(self.model, np.ones(self.model.ngeom, bool))
        return only

    def cast_at(self, origins: Floats, directions: Floats, geom_id: Ints, normals: Floats | None = None) -> RayHits:
        """Return what each ray hits when its own geom, `geom_id` (n,), is all that it could hit.

        normals: not used; mj_ray names one face of a geom.
        """
        del normals
        only = self._one_by_one
        hits = RayHits.misses(len(geom_id))
        for geom in np.unique(geom_id[geom_id >= 0]):
            rays = geom_id == geom
            only.model.geom_matid[geom] = self.model.geom_matid[geom]
            only.model.geom_rgba[geom] = self.model.geom_rgba[geom]
            hits.put(rays, only.cast(origins[rays], directions[rays]))
            only.model.geom_matid[geom] = -1
            only.model.geom_rgba[geom, 3] = 0
        return hits


def require_answerable(model: mujoco.MjModel, data: mujoco.MjData, filter: Filter | None) -> None:
    """Raise InputError if mj_ray would answer for another model or state, or end the process."""
    require_type("oracle: model", model, mujoco.MjModel)
    require_type("oracle: data", data, mujoco.MjData)
    require_type("oracle: filter", filter, Filter, NoneType)
    if data.signature != model.signature:
        raise InputError("oracle: data belongs to another model than that given")
    require_posed("oracle: data", data)
    refuse("oracle: filter", [] if filter is None else filter.faults(model))


def _excluded_bodies(model: mujoco.MjModel, filter: Filter) -> set[int]:
    """Return the ids of the bodies whose geoms the filter excludes."""
    bodies = {model.body(name).id for name in filter.exclude_bodies}
    if filter.exclude_subtree:  # a parent comes before its children
        for body in range(1, model.nbody):
            if int(model.body_parentid[body]) in bodies:
                bodies.add(body)
    return bodies


def _group_flags(filter: Filter) -> npt.NDArray[np.uint8] | None:
    if filter.geom_groups is None:
        return None
    return np.array([group in filter.geom_groups for group in range(6)], np.uint8)


def _unsayable(model: mujoco.MjModel, filter: Filter, bodies: set[int]) -> Bools:
    """Return (ngeom,) True for what must be hidden because mj_ray's arguments cannot exclude it."""
    hidden = np.zeros(model.ngeom, bool)
    for geom in range(model.ngeom):
        collides = bool(model.geom_contype[geom]) or bool(model.geom_conaffinity[geom])
        hidden[geom] = int(model.geom_bodyid[geom]) in bodies
        hidden[geom] |= collides if filter.geometry == "visual" else False
        hidden[geom] |= not collides if filter.geometry == "collision" else False
    return hidden


def _with_hidden(model: mujoco.MjModel, hidden: Bools) -> mujoco.MjModel:
    """Return the model itself, or a copy in which mj_ray cannot see the hidden geoms."""
    if not hidden.any():
        return model
    private = copy.copy(model)
    private.geom_matid[hidden] = -1
    private.geom_rgba[hidden, 3] = 0
    return private


def flat_rays(origins: npt.ArrayLike, directions: npt.ArrayLike) -> tuple[Floats, Floats]:
    """Return origins and unit directions, (n, 3) each, C-contiguous."""
    directions = np.asarray(directions, np.float64)
    if directions.shape[-1:] != (3,) or np.shape(origins)[-1:] != (3,):
        raise InputError(f"oracle: got origins {np.shape(origins)}, directions {directions.shape}; expected (..., 3)")
    starts = np.broadcast_to(np.asarray(origins, np.float64), directions.shape).reshape(-1, 3)
    flat = directions.reshape(-1, 3)
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    bad = np.flatnonzero(~(np.isfinite(starts).all(axis=1) & np.isfinite(length[:, 0]) & (length[:, 0] > 0)))
    if bad.size:
        raise InputError(f"ray {bad[0]}: got origin {starts[bad[0]]}, direction {flat[bad[0]]}; expected finite, not 0")
    return np.ascontiguousarray(starts), flat / length
