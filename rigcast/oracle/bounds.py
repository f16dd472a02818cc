"""Bounds within which two answers agree, and the form of a valid answer."""

import numpy as np

from rigcast.oracle.ray import Bools, Floats, RayHits
from rigcast.oracle.world import World

DISTANCE_BOUND = 1e-5  # of 1 + t, over |cos| of the angle of incidence
SMALLEST_COS = 1e-3
NORMAL_BOUND = 1e-3  # of 1 - n . n_ref
TIE = 2e-6  # of 1 + t: objects this close along the ray count as equally far


def missed(hits: RayHits) -> Bools:
    return np.isposinf(hits.distance) & (hits.geom_id == -1) & (hits.normal == 0).all(axis=1)


def well_formed(hits: RayHits, count: int) -> Bools:
    """Return (n,) True for well-formed misses, and for hits on one of `count` objects with distance and unit normal."""
    unit = np.abs(np.linalg.norm(hits.normal, axis=1) - 1) <= NORMAL_BOUND
    hit = np.isfinite(hits.distance) & (hits.distance >= 0) & (hits.geom_id >= 0) & (hits.geom_id < count) & unit
    return hit | missed(hits)


def distance_errors(unit: Floats, got: RayHits, reference: RayHits) -> tuple[Floats, Floats]:
    """Return |t - t_ref| (n,), and the same over its bound, 1e-5 (1 + t_ref) / max(|d . n_ref|, 1e-3)."""
    with np.errstate(invalid="ignore"):
        error = np.where(missed(got) & missed(reference), 0.0, np.abs(got.distance - reference.distance))
    error[np.isnan(error)] = np.inf  # inf - inf of a malformed miss, or a NaN of the caster
    slant = np.maximum(np.abs((unit * reference.normal).sum(axis=1)), SMALLEST_COS)
    reach = np.where(np.isfinite(reference.distance), reference.distance, 0.0)
    return error, error * slant / (DISTANCE_BOUND * (1 + reach))


def agrees(unit: Floats, got: RayHits, reference: RayHits) -> Bools:
    """Return (n,) True where got is the reference to the bounds: the same id, distance and unit normal."""
    _, scaled = distance_errors(unit, got, reference)
    length = np.linalg.norm(got.normal, axis=1)
    turned = 1 - (got.normal * reference.normal).sum(axis=1)
    normal = (turned <= NORMAL_BOUND) & (np.abs(length - 1) <= NORMAL_BOUND)
    same = (got.geom_id == reference.geom_id) & (scaled <= 1)
    return same & (normal | (missed(got) & missed(reference)))


def tied(world: World, starts: Floats, unit: Floats, got: RayHits, expected: RayHits) -> RayHits:
    """Return each ray's reference: `expected`, or the oracle's answer for the tied object or face named."""
    both_hit = (expected.geom_id >= 0) & (got.geom_id >= 0) & (got.geom_id < world.count)
    other_side = (got.normal * expected.normal).sum(axis=1) < 0
    rays = np.flatnonzero(both_hit & ((got.geom_id != expected.geom_id) | other_side))
    if not rays.size:
        return expected
    other = world.cast_at(starts[rays], unit[rays], got.geom_id[rays], got.normal[rays])
    nearest = expected.distance[rays]
    close = np.abs(other.distance - nearest) <= TIE * (1 + nearest)
    held = expected.take(np.arange(len(unit)))
    held.put(rays[close], other.take(close))
    return held
