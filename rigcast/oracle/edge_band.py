"""The edge band: whether mj_ray gives a caster's answer for a ray close to the given one."""

import functools

import numpy as np

from rigcast.oracle.bounds import DISTANCE_BOUND, SMALLEST_COS, agrees, tied
from rigcast.oracle.ray import Floats, RayHits, flat_rays
from rigcast.oracle.world import World

MOVE = 1e-5  # origins move by at most this times 1 + t [m], directions by at most this [rad]


def in_edge_band(world: World, start: Floats, unit: Floats, got: RayHits, expected: RayHits) -> bool:
    """Return whether mj_ray gives the caster's answer for a ray close to this one."""
    reach = MOVE * (1 + min(got.distance[0], expected.distance[0]))  # both cannot be inf: that would agree
    moves, tilts = _neighbours()
    frame = _frame(unit)
    _, towards = flat_rays(start, unit + MOVE * tilts @ frame[:2])
    candidates = [(start + reach * moves @ frame, towards)]
    if np.isfinite(got.distance[0]):
        point = _on_its_surface(world, start, unit, got)
        candidates += _through(point, got.distance[0], got.normal[0], unit, towards, reach)
    origins, directions = (np.vstack(part) for part in zip(*candidates, strict=True))
    near = np.flatnonzero(np.linalg.norm(origins - start, axis=1) <= reach * (1 + 1e-9))
    for part in np.split(near, [16, 64, 256]):  # most disputes end within the first few
        starts, along, own = origins[part], directions[part], got.take(np.zeros(len(part), int))
        answers = tied(world, starts, along, own, world.cast(starts, along))
        if agrees(along, own, answers).any():
            return True
    return False


def _on_its_surface(world: World, start: Floats, unit: Floats, got: RayHits) -> Floats:
    """Return the point that the caster claims to have hit, put onto the surface that it names, along its normal."""
    t, normal = got.distance[0], got.normal[0]
    point = start + t * unit
    above = 2 * MOVE * (1 + t)
    foot = world.cast_at((point + above * normal)[None], -normal[None], got.geom_id, normal[None]).distance[0]
    put: Floats = point + (above - foot if foot <= 2 * above else 0.0) * normal
    return put


def _through(
    point: Floats, t: float, normal: Floats, unit: Floats, towards: Floats, reach: float
) -> list[tuple[Floats, Floats]]:
    """Return rays, as origins and directions (k, 3), that meet the surface at or near a point at the distance t.

    At grazing incidence a tiny move is a large change of distance, and a face may be seen through a gap far narrower
    than the band: no list of moves meets these, so here the point to be met is moved, within the face's plane, and
    along the ray as far as the distance may err.
    """
    cos = max(abs(float(unit @ normal)), SMALLEST_COS)
    stretch = 0.5 * DISTANCE_BOUND * (1 + t) / cos
    across = np.cross(normal, unit)
    across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-9 else _frame(normal)[0]
    rays = [(point + step * unit - (t + step) * towards, towards) for step in (0.0, stretch, -stretch)]
    within = _disc() * (stretch, reach) @ np.stack([np.cross(across, normal), across])
    for tilt in (0.0, -0.3, 0.3):
        _, direction = flat_rays(point, (unit + tilt * MOVE * normal)[None])
        rays.append((point + within - t * direction, np.broadcast_to(direction, within.shape)))
    return rays


def _frame(unit: Floats) -> Floats:
    """Return (3, 3): two unit vectors across the ray, and the ray's own."""
    u = np.cross(unit, np.eye(3)[np.argmin(np.abs(unit))])
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(unit, u), unit])


@functools.cache
def _disc() -> Floats:
    """Return (k, 2) points of the unit disc, of any magnitude from 1e-4 to 1."""
    return _shorter(np.random.default_rng(1).normal(size=(256, 2)), np.random.default_rng(2))


@functools.cache
def _neighbours() -> tuple[Floats, Floats]:
    """Return the moves (k, 3) of the origin (u, v, along) and the tilts (k, 2) of the direction, all of
    length <= 1.

    First the ray shifted and tilted to one side, in 12 directions and 6 magnitudes, then shifts along the
    ray, then moves at random, of any magnitude from 1e-4 to 1.
    """
    magnitudes = np.array([1.0, 0.1, 0.01, 0.001, 0.0001, 0.4])
    angles = np.arange(12) * 7 * (2 * np.pi / 12)  # 7 is coprime to 12: the first few already point all ways
    sides = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ring = np.pad((magnitudes[:, None, None] * sides).reshape(-1, 2), ((0, 0), (0, 1)))
    along = np.concatenate([magnitudes, -magnitudes])[:, None] * np.array([[0, 0, 1]])
    rng = np.random.default_rng(0)
    free, turned = (_shorter(rng.normal(size=(256, width)), rng) for width in (3, 2))
    return np.vstack([ring, along, free]), np.vstack([ring[:, :2], along[:, :2], turned])


def _shorter(vectors: Floats, rng: np.random.Generator) -> Floats:
    """Return the vectors with lengths from 1e-4 to 1, evenly in the logarithm."""
    lengths = 10.0 ** rng.uniform(-4, 0, (len(vectors), 1))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True) * lengths
