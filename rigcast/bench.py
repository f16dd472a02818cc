"""Rays per second of a rig's sensors, beside MuJoCo's own casters on the same rays in the same run.

A caster that is fast by being wrong shows as such: beside each speed stands the fraction of its rays that
mj_ray agrees with.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast.oracle import Oracle, RayHits
from rigcast.oracle.bounds import agrees
from rigcast.sensors.rig.rig import Rig

FARTHEST = 1e10  # [m] mj_multiRay's cutoff: none


@dataclass(frozen=True)
class Speed:
    """M rays/s of one caster over the rounds, and the fraction of its rays that agree with mj_ray.

    ratio: rigcast's median over this one's.
    """

    caster: str
    median: float
    lowest: float
    highest: float
    agree: float
    ratio: float


@dataclass(frozen=True)
class Result:
    """The casters' speeds on the rays of one sensor."""

    sensor: str
    shape: tuple[int, ...]
    speeds: tuple[Speed, ...]


@dataclass(frozen=True, eq=False)
class _Caster:
    """A way to cast; `rays` says which of the sensor's flat rays it casts."""

    name: str
    rays: npt.NDArray[np.intp]
    cast: Callable[[], Any]


def bench(
    rig: Rig, data: mujoco.MjData, names: Sequence[str], *, rounds: int = 7, sample: int = 20_000
) -> tuple[Result, ...]:
    """Time the named sensors, each of whose rays share one origin, in the state of `data`.

    Casters take turns, `rounds` times, after a round that does not count. rigcast's time is that of bringing
    the scene up to date, casting, and handing distances, ids, faces and normals over as numpy. mj_ray casts
    `sample` of the rays, spread evenly, and so many are compared.
    """
    return tuple(_bench_sensor(rig, data, name, rounds, sample) for name in names)


def _bench_sensor(rig: Rig, data: mujoco.MjData, name: str, rounds: int, sample: int) -> Result:
    rays = rig.rays(data, [name])[name]
    shape = rays.directions.shape[:-1]
    origin, directions = rays.origins.reshape(-1, 3)[0], rays.directions.reshape(-1, 3)
    spec = next(spec for spec in rig.sensors if spec.name == name)
    every = np.arange(len(directions))
    some = np.unique(np.linspace(0, len(directions) - 1, min(sample, len(directions))).astype(np.intp))
    oracle = Oracle(rig.model, _posed(rig.model, data), spec.filter)
    casters = (
        _Caster("rigcast", every, lambda: rig.cast(data, [name])[name].numpy()),
        _Caster("mj_multiRay", every, lambda: _multi_ray(oracle, origin, directions)),
        _Caster("mj_ray", some, lambda: oracle.cast(origin, directions[some])),
    )
    seconds, hits = _take_turns(casters, rounds)
    answers = [RayHits.of(hit) for hit in hits]
    answers = [hit if len(hit.distance) == len(some) else hit.take(some) for hit in answers]
    agree = [float(agrees(directions[some], answer, answers[-1]).mean()) for answer in answers]
    return Result(name, shape, tuple(_speeds(casters, seconds, agree)))


def _posed(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """Return a copy with the poses of `data.time`, and what mj_multiRay's tree needs besides."""
    posed = mujoco.MjData(model)
    mujoco.mj_copyData(posed, model, data)
    mujoco.mj_kinematics(model, posed)
    mujoco.mj_comPos(model, posed)
    return posed


def _multi_ray(oracle: Oracle, origin: npt.NDArray[np.float64], directions: npt.NDArray[np.float64]) -> RayHits:
    count = len(directions)
    hits = RayHits(np.empty(count), np.empty(count, np.int32), np.empty((count, 3)))
    mujoco.mj_multiRay(
        oracle.model,
        oracle.data,
        origin,
        directions.ravel(),
        oracle.groups,
        oracle.static,
        oracle.body,
        hits.geom_id,
        hits.distance,
        hits.normal.ravel(),
        count,
        FARTHEST,
    )
    hits.distance[hits.geom_id < 0] = np.inf
    return hits


def _take_turns(casters: Sequence[_Caster], rounds: int) -> tuple[npt.NDArray[np.float64], list[Any]]:
    """Return the seconds (rounds, casters) that each took, and what each hit."""
    hits = [caster.cast() for caster in casters]
    seconds = np.empty((rounds, len(casters)))
    for turn in range(rounds):
        for i, caster in enumerate(casters):
            began = time.perf_counter()
            hits[i] = caster.cast()
            seconds[turn, i] = time.perf_counter() - began
    return seconds, hits


def _speeds(casters: Sequence[_Caster], seconds: npt.NDArray[np.float64], agree: Sequence[float]) -> list[Speed]:
    counts = np.array([len(caster.rays) for caster in casters])
    mrays = counts / seconds / 1e6
    median = np.median(mrays, axis=0)
    return [
        Speed(caster.name, float(median[i]), float(low), float(high), agree[i], float(median[0] / median[i]))
        for i, (caster, low, high) in enumerate(zip(casters, mrays.min(axis=0), mrays.max(axis=0), strict=True))
    ]
