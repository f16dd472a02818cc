"""Timing of casters in turn on the same rays, and the correctness of each.

A caster that is fast because it is wrong shows as such: each speed comes with the fraction of rays that mj_ray confirms
and the fraction within a centimetre of it, for casters that tessellate round shapes.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from rigcast.oracle import RayHits
from rigcast.oracle.bounds import distance_errors

from .casters.caster import Answer, Caster, Floats
from .casters.with_mj_ray import MjRay
from .figure import Spread
from .workloads import View, Workload

CLOSE = 0.01  # [m]
TURN = 0.1  # [s] least duration of a caster's turn
PATIENCE = 2.0  # [s] casters with slower frames are timed on the sample of rays only


@dataclass(frozen=True)
class Speed:
    """One caster on the rays of one sensor.

    mrays: millions of rays per second. ratio: rigcast's speed over this one's, by round; cpu_ratio: the same by the
    CPU time of all threads, which other work on the machine disturbs less. rays: number of rays of a timed frame.
    agree: fraction of the sample with the hits, misses and distances of mj_ray, to 1e-5 (1 + t) / max(|cos|, 1e-3);
    close: to 1 cm.
    """

    caster: str
    rays: int
    mrays: Spread
    ratio: Spread
    cpu_ratio: Spread
    agree: float
    close: float


@dataclass(frozen=True)
class Result:
    """The casters on the rays of one sensor in one workload."""

    workload: str
    sensor: str
    shape: tuple[int, ...]
    geoms: int
    triangles: int
    speeds: tuple[Speed, ...]


@dataclass(frozen=True, eq=False)
class _Runner:
    caster: str
    rays: int
    frame: Callable[[], Answer]


def race(workload: Workload, casters: Sequence[type[Caster]], rounds: int, sample: int = 4000) -> list[Result]:
    """Time the casters, rigcast first among them, on each of the workload's sensors.

    A frame consists of the update of poses, the cast of all rays of the sensor, and the transfer to numpy of those of
    distances, ids and normals that the caster reports. `sample` rays, spread evenly, are compared with mj_ray.
    """
    scene = workload.model, workload.data, workload.groups
    built = [caster(*scene) for caster in casters]
    return [_race(workload, view, built, rounds, sample) for view in workload.views]


def _race(workload: Workload, view: View, casters: Sequence[Caster], rounds: int, sample: int) -> Result:
    directions = np.ascontiguousarray(view.directions.reshape(-1, 3))
    some = spread_over(len(directions), sample)
    reference = MjRay(workload.model, workload.data, workload.groups).oracle.cast(view.origin, directions[some])
    runners, right = [], []
    for caster in casters:
        on_sample, frame = caster.aim(view.origin, directions[some]), caster.aim(view.origin, directions)
        right.append(rightness(directions[some], on_sample(), reference))
        expected = _seconds(on_sample)[0] * len(directions) / len(some)
        is_slow = expected > 5 * PATIENCE or _seconds(frame)[0] > PATIENCE
        runners.append(_Runner(caster.name, len(some if is_slow else directions), on_sample if is_slow else frame))
    times = in_turns({runner.caster: runner.frame for runner in runners}, rounds)
    speed = {runner.caster: runner.rays / times[runner.caster] / 1e6 for runner in runners}
    speeds = []
    for runner, (agree, close) in zip(runners, right, strict=True):
        mrays, ratio = speed[runner.caster], speed[runners[0].caster] / speed[runner.caster]
        spreads = Spread.of(mrays[0]), Spread.of(ratio[0]), Spread.of(ratio[1])
        speeds.append(Speed(runner.caster, runner.rays, *spreads, agree, close))
    shape = view.directions.shape[:-1]
    return Result(workload.name, view.sensor, shape, workload.model.ngeom, triangles_of(workload.model), tuple(speeds))


def in_turns(
    what: Mapping[str, Callable[[], Any]], rounds: int, settle: Callable[[], object] = lambda: None
) -> dict[str, Floats]:
    """Return (2, rounds) for each: the wall-clock seconds of a run, and the CPU seconds of all threads.

    All run once, untimed, before the first round. Every other round is in reverse order. settle: waits for work that
    runs have launched without waiting.
    """
    for run in what.values():
        run()
    times = {name: np.empty((2, rounds)) for name in what}
    for turn in range(rounds):
        for name in list(what)[:: 1 if turn % 2 == 0 else -1]:
            times[name][:, turn] = _turn(what[name], settle)
    return times


def _turn(run: Callable[[], Any], settle: Callable[[], object]) -> tuple[float, float]:
    """The mean seconds of a run, over consecutive runs for TURN seconds, after one run that warms the caches.

    A run that takes TURN seconds or more is not repeated. Its result is released after the next run has returned, as in
    a loop that steps a simulation.
    """
    first = _seconds(run, settle)
    if first[0] >= TURN:
        return first
    runs = math.ceil(TURN / first[0])
    clock, cpu = _seconds(lambda: deque((run() for _ in range(runs)), maxlen=1), settle)
    return clock / runs, cpu / runs


def _seconds(run: Callable[[], Any], settle: Callable[[], object] = lambda: None) -> tuple[float, float]:
    settle()
    began, cpu_began = time.perf_counter(), time.process_time()
    run()
    settle()
    return time.perf_counter() - began, max(time.process_time() - cpu_began, 1e-9)


def spread_over(count: int, most: int) -> Sequence[int]:
    """Return at most `most` of the numbers below `count`, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(int)).tolist()


def rightness(directions: Floats, answer: Answer, reference: RayHits) -> tuple[float, float]:
    """Return the fraction of rays that agrees with mj_ray, and the fraction that is close."""
    distance = np.asarray(answer.distance, np.float64)
    hit = ~np.isposinf(distance)
    # only hit, miss and distance are compared: not every caster reports ids and normals
    got = RayHits(distance, np.where(hit, 0, -1).astype(np.int32), np.where(hit[:, None], 1.0, np.zeros(3)))
    error, scaled = distance_errors(directions, got, reference)
    return float((scaled <= 1).mean()), float((error <= CLOSE).mean())


def triangles_of(model: mujoco.MjModel) -> int:
    """Return the number of triangles of a model's meshes and height fields, each counted once."""
    cells = (model.hfield_nrow - 1) * (model.hfield_ncol - 1)
    return int(model.nmeshface + 2 * cells.sum())
