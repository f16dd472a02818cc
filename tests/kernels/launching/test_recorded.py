"""A recorded launch does at each call what Warp's own launch does."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

from rigcast.kernels.hits.reading import depth_along_z
from rigcast.kernels.launching.recorded import _ByWarp, _Shortened, recorded
from rigcast.kernels.rays.arrays import RayArrays

DISTANCE = np.arange(1.0, 5.0)


def directions(z: float, device: str) -> wp.array:
    return wp.full(4, wp.vec3d(0.0, 0.0, z), dtype=wp.vec3d, device=device)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def test_a_launch_reads_the_present_values_of_structs(device: str) -> None:
    rays, distance = RayArrays(), wp.array(DISTANCE, dtype=float, device=device)
    rays.directions = directions(1.0, device)
    depth = wp.zeros(4, dtype=float, device=device)
    launch = recorded(depth_along_z, 1, [0, 4, rays, distance], [depth], device)
    for z in (1.0, 0.5, -0.25):
        rays.directions = directions(z, device)
        launch()
        np.testing.assert_array_equal(depth.numpy(), z * DISTANCE)


def test_arguments_are_kept_for_as_long_as_a_launch() -> None:
    rays, depth = RayArrays(), wp.zeros(4, dtype=float, device="cpu")
    rays.directions = directions(0.5, "cpu")
    launch = recorded(depth_along_z, 1, [0, 4, rays, wp.array(DISTANCE, dtype=float, device="cpu")], [depth], "cpu")
    del rays
    for _ in range(3):
        launch()
        wp.full(4, 7.0, dtype=float, device="cpu")  # takes memory that is free
    np.testing.assert_array_equal(depth.numpy(), 0.5 * DISTANCE)


@pytest.mark.parametrize(
    "calls", [[], [("bounds", "no struct")], [("bounds",), ("bounds",)]], ids=["none", "no struct", "two"]
)
def test_a_function_that_warp_calls_in_another_way_is_left_to_warp(calls: list[tuple[Any, ...]]) -> None:
    made, compiled = [], []
    command: Any = SimpleNamespace(hooks=SimpleNamespace(forward=lambda *arguments: compiled.append(arguments)))

    def launch() -> None:
        made.append(1)
        for arguments in calls:
            command.hooks.forward(*arguments)

    command.launch = launch
    again = _Shortened(command, ())
    for count in (1, 2, 3):
        again()
        assert len(made) == count
        assert compiled == calls * count


@pytest.mark.parametrize(
    ("parts", "kind"),
    [
        (lambda command: command, _Shortened),
        (lambda command: SimpleNamespace(launch=command.launch, params=command.params), _ByWarp),
        (lambda command: SimpleNamespace(launch=command.launch, params=command.params, hooks=object()), _ByWarp),
        (lambda command: SimpleNamespace(launch=command.launch, hooks=command.hooks), _ByWarp),
        (lambda command: SimpleNamespace(launch=command.launch, hooks=command.hooks, params=[0]), _ByWarp),
    ],
    ids=["all", "no hooks", "no forward", "no params", "other params"],
)
def test_a_launch_without_the_parts_that_are_known_is_left_to_warp(
    parts: Callable[[Any], Any], kind: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    launch = wp.launch
    monkeypatch.setattr(wp, "launch", lambda *given, **named: parts(launch(*given, **named)))
    rays, depth = RayArrays(), wp.zeros(4, dtype=float, device="cpu")
    rays.directions = directions(1.0, "cpu")
    inputs = [0, 4, rays, wp.array(DISTANCE, dtype=float, device="cpu")]
    again = recorded(depth_along_z, 1, inputs, [depth], "cpu")
    assert type(again) is kind
    for z in (1.0, 0.5, -0.25):
        rays.directions = directions(z, "cpu")
        again()
        np.testing.assert_array_equal(depth.numpy(), z * DISTANCE)
