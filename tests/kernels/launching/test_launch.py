"""Threads that launch a kernel for the first time at once load its module one at a time; else the process can crash."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import warp as wp

import rigcast.kernels.launching.launch as launching
from rigcast.kernels.hits.reading import depth_along_z
from rigcast.kernels.launching.launch import launch
from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.rays.arrays import RayArrays


@pytest.mark.parametrize("how", [launch, recorded])
def test_modules_are_loaded_by_one_thread_at_a_time(how: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rays, distance, depth = RayArrays(), wp.ones(4, dtype=float, device="cpu"), wp.empty(4, dtype=float, device="cpu")
    rays.directions = wp.full(4, wp.vec3d(0.0, 0.0, 1.0), dtype=wp.vec3d, device="cpu")
    at_work: list[int] = []
    most = []
    original = wp.launch

    def slow_launch(*arguments: Any, record_cmd: bool = False, **named: Any) -> Any:
        if record_cmd:
            at_work.append(1)
            most.append(len(at_work))
            time.sleep(0.01)
            at_work.pop()
        return original(*arguments, record_cmd=record_cmd, **named)

    monkeypatch.setattr(launching, "_loaded", set())
    monkeypatch.setattr(wp, "launch", slow_launch)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: how(depth_along_z, 1, [0, 4, rays, distance], [depth], "cpu"), range(4)))
    assert set(most) == {1}, most  # a thread that is late finds the kernel loaded


def test_a_launch_of_nothing_loads_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted as a first launch, it would let a later one load the module in several threads at once."""
    loaded: set[Any] = set()
    monkeypatch.setattr(launching, "_loaded", loaded)
    empty = wp.empty(0, dtype=float, device="cpu")
    launch(depth_along_z, 0, [0, 4, RayArrays(), empty], [empty], "cpu")
    assert loaded == set()
