"""The gain of each step that makes the cast fast: rays per second with it over those without it."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

from rigcast.bench.casters.with_rigcast import RigcastCaster
from rigcast.bench.figure import Spread
from rigcast.bench.race import in_turns
from rigcast.bench.workloads import View, Workload, hills, warehouse
from rigcast.kernels.launching.slices import thread_count
from rigcast.kernels.trees import tree

ROUNDS = 5


@dataclass(frozen=True)
class Step:
    """A step, what takes its place without it, and its gain on the rays of several sensors."""

    name: str
    without: str
    gains: dict[str, Spread]


def steps() -> list[Step]:
    """Measure them all on the camera and the lidar of two scenes."""
    cases = [(workload, view) for workload in (warehouse(), hills(300_000)) for view in workload.views]
    ways = (
        ("packets of rays", "every ray alone", _alone, 1),
        ("trees split by surface area", "trees halved by count", _balanced, 1),
        (f"{thread_count()} threads", "one thread", _one_thread, 0),
    )
    return [
        Step(name, without, {f"{w.name}, {v.sensor}": _gain(w, v, way, clock) for w, v in cases})
        for name, without, way, clock in ways
    ]


def _gain(workload: Workload, view: View, without: Callable[[Workload, View], Any], clock: int) -> Spread:
    """Rays per second with the step over those without it, by wall clock (clock 0) or CPU time (1)."""
    times = in_turns({"with": _frame(workload, view), "without": without(workload, view)}, ROUNDS)
    return Spread.of(times["without"][clock] / times["with"][clock])


def _frame(workload: Workload, view: View) -> Callable[[], Any]:
    caster = RigcastCaster(workload.model, workload.data, workload.groups)
    return caster.aim(view.origin, np.ascontiguousarray(view.directions.reshape(-1, 3)))


def _alone(workload: Workload, view: View) -> Callable[[], Any]:
    scene = RigcastCaster(workload.model, workload.data, workload.groups)
    directions = np.ascontiguousarray(view.directions.reshape(-1, 3))
    return scene.aim(np.broadcast_to(view.origin, directions.shape), directions)


def _balanced(workload: Workload, view: View) -> Callable[[], Any]:
    with _balanced_trees(), patch.dict(os.environ, RIGCAST_CACHE="off"):
        return _frame(workload, view)


@contextmanager
def _balanced_trees() -> Iterator[None]:
    build = tree._build

    def halved(lower: Any, upper: Any, leaf_size: int, **_: bool) -> Any:
        return build(lower, upper, leaf_size, balanced=True)

    with patch.object(tree, "_build", halved):
        yield


def _one_thread(workload: Workload, view: View) -> Callable[[], Any]:
    return partial(_run_on_one_thread, _frame(workload, view))


def _run_on_one_thread(frame: Callable[[], Any]) -> Any:
    with patch.dict(os.environ, RIGCAST_THREADS="1"):
        return frame()
