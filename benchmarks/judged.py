"""Comparison of a caster's rays with mj_ray, and the rows of its table."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

import rigcast
from rigcast.bench.casters import Answer, Caster, Floats
from rigcast.oracle import Comparison, Oracle, RayHits, Things, Verdict, compare
from rigcast.oracle.things import TYPES

MOVE = 1e-5  # of 1 + t [m]: the edge band of rigcast.oracle


@dataclass(frozen=True)
class Batch:
    """Rays through one state of a model, and props on it: origins (n, 3) [m], unit directions (n, 3), in the world."""

    model: mujoco.MjModel
    data: mujoco.MjData
    origins: Floats
    directions: Floats
    props: tuple[rigcast.Prop, ...] = ()


@dataclass(frozen=True)
class Row:
    """The rays of one caster at one type of geom; errors |t - t_ref| [m] are those of rays that agree, NaN for none."""

    geom_type: str
    rays: int
    agree: int
    edge: int
    wrong: int
    worst: float
    p999: float


def judge(caster: Callable[[mujoco.MjModel, mujoco.MjData], Caster], batch: Batch) -> Comparison:
    """Cast a batch and compare it with mj_ray, ray by ray."""
    model, data, origins, directions = batch.model, batch.data, batch.origins, batch.directions
    hits = completed(batch, caster(model, data).aim(origins, directions)())
    return compare(model, data, origins, directions, hits, props=batch.props)


def completed(batch: Batch, answer: Answer) -> RayHits:
    """Return the answer, with what its caster does not report taken from mj_ray in the caster's favour.

    Ids and normals are those of mj_ray's hit nearest to the distance that the caster gives, among the ray and
    12 neighbours within the edge band.
    """
    if answer.geom_id is not None and answer.normal is not None:
        return RayHits.of(answer)
    distance = np.asarray(answer.distance, np.float64)
    missed = np.isposinf(distance)
    oracle = Oracle(batch.model, batch.data)
    nearest = oracle.cast(batch.origins, batch.directions)
    rays = np.flatnonzero(~missed & ~np.isclose(nearest.distance, distance, rtol=0, atol=MOVE))
    for move in _moves():
        reach = MOVE * (1 + np.minimum(distance[rays], nearest.distance[rays]))[:, None]
        other = oracle.cast(batch.origins[rays] + reach * move, batch.directions[rays])
        closer = np.abs(other.distance - distance[rays]) < np.abs(nearest.distance[rays] - distance[rays])
        nearest.put(rays[closer], other.take(closer))
    return RayHits(distance, np.where(missed, -1, nearest.geom_id), np.where(missed[:, None], 0.0, nearest.normal))


def _moves() -> Floats:
    """Return (12, 3) vectors of lengths up to 1 in random directions."""
    vectors = np.random.default_rng(0).normal(size=(12, 3))
    lengths = np.tile([0.999, 0.1, 0.01], 4)[:, None]
    moves: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True) * lengths
    return moves


def rows(batches: list[Batch], found: list[Comparison]) -> Iterator[Row]:
    """Yield one row for each type of geom that was hit, one for rays that miss, and one for all."""
    pairs = zip(batches, found, strict=True)
    kind = np.concatenate([Things.of(batch.model, batch.props).types_of(f.things()) for batch, f in pairs])
    verdict = np.concatenate([f.verdict for f in found])
    error = np.concatenate([f.error for f in found])
    for one in sorted(set(kind.tolist()), key=TYPES.index):
        yield _row(one, verdict[kind == one], error[kind == one])
    yield _row("all", verdict, error)


def _row(name: str, verdict: npt.NDArray[np.int8], error: Floats) -> Row:
    agreed = error[verdict == Verdict.AGREE]
    worst, p999 = (float(agreed.max()), float(np.quantile(agreed, 0.999))) if agreed.size else (np.nan, np.nan)
    agree, edge, wrong = (int((verdict == each).sum()) for each in Verdict)
    return Row(name, len(verdict), agree, edge, wrong, worst, p999)
