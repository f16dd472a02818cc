"""The judge: MuJoCo's own `mj_ray`, ray by ray in float64, and the one definition of a wrong ray.

mj_ray answers for geoms; for flexes, skins and props stand `mj_rayFlex`, `mju_raySkin` and mj_ray on the prop's mesh,
and of an SDF geom mj_ray on its mesh (see `World`). All of these are "mj_ray" and "geoms" below.

With t in metres along a unit direction d, t_ref, n_ref and id_ref mj_ray's answer, a caster's answer (t, id, n)

- **agrees** when both miss, or when id = id_ref, or both geoms lie within 2e-6 (1 + t_ref) of each other
  along the ray (the reference is then mj_ray's answer for the geom that the caster names), and
      |t - t_ref| <= 1e-5 (1 + t_ref) / max(|d . n_ref|, 1e-3)    and    1 - n . n_ref <= 1e-3;
- is **in the edge band** when it does not agree, but some ray with its origin moved by at most 1e-5 (1 + t)
  and its direction by at most 1e-5 rad makes mj_ray give the caster's own distance, id and normal (a caster's
  miss: a miss), where the rule for ties holds as it does above;
- is **wrong** otherwise.

The band is there because mj_ray itself leaks at edges: aimed exactly at the vertices of a mesh sphere a third
of its rays miss. A miss is distance +inf, id -1, normal 0; anything else, NaN included, is not a miss and not
a hit: wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast.oracle.bounds import agrees, distance_errors, tied, well_formed
from rigcast.oracle.edge_band import in_edge_band
from rigcast.oracle.ray import Floats, Ints, RayHits, flat_rays
from rigcast.oracle.things import Things
from rigcast.oracle.world import World
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop


class Verdict(IntEnum):
    """The judge's verdict on one ray."""

    AGREE = 0
    EDGE = 1
    WRONG = 2


@dataclass(frozen=True)
class Comparison:
    """n rays of a caster beside mj_ray's.

    verdict (n,) int8 of `Verdict`; error (n,) = |t - t_ref| [m]; scaled (n,) = error over the bound that the
    definition allows; both are 0 where both miss and inf where only one does. got, expected: the two answers, their
    ids by `Things`.
    """

    verdict: npt.NDArray[np.int8]
    error: Floats
    scaled: Floats
    got: RayHits
    expected: RayHits

    def where(self, verdict: Verdict) -> npt.NDArray[np.intp]:
        """Return the indices of the rays with this verdict."""
        return np.flatnonzero(self.verdict == verdict)

    def things(self) -> Ints:
        """Return (n,) the object under which each ray is counted: mj_ray's hit, else the caster's, else -1."""
        return np.where(self.expected.geom_id >= 0, self.expected.geom_id, self.got.geom_id)


def compare(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    hits: Any,
    filter: Filter | None = None,
    props: Sequence[Prop] = (),
) -> Comparison:
    """Judge a caster's answer by this module's definition.

    origins (3,) or (..., 3) and directions (..., 3): the rays, in the world frame; hits: the caster's answer, an
    object with distance (...), geom_id (...) and normal (..., 3) as arrays, and flex_id, skin_id, prop_id where it
    knows these (`Hits.numpy()`); props: of the caster's scene. Poses, vertices of flexes and bones of skins are those
    of `data` as they stand. Rays are flat and in C order in the result. Raises InputError as `Oracle` does, and for
    hits of another number of rays.
    """
    world = World(model, data, filter, props)
    starts, unit = flat_rays(origins, directions)
    got = _hits_of(hits, Things.of(model, props), len(unit))
    expected = world.cast(starts, unit)
    reference = tied(world, starts, unit, got, expected)
    error, scaled = distance_errors(unit, got, reference)
    verdict = np.where(agrees(unit, got, reference), Verdict.AGREE, Verdict.WRONG).astype(np.int8)
    for ray in np.flatnonzero((verdict == Verdict.WRONG) & well_formed(got, world.count)):
        if in_edge_band(world, starts[ray], unit[ray], got.take([ray]), expected.take([ray])):
            verdict[ray] = Verdict.EDGE
    return Comparison(verdict, error, scaled, got, expected)


def _hits_of(hits: Any, things: Things, rays: int) -> RayHits:
    flat = RayHits.of(hits)._replace(geom_id=things.numbers(hits))
    lengths = tuple(len(part) for part in flat)
    if lengths != (rays, rays, rays):
        raise InputError(f"hits of {rays} rays expected, got distances, ids, normals of {lengths}")
    return flat
