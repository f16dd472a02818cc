"""Simulations run by commands: initial state, length, and time spent."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Literal

import mujoco


@dataclass
class Spent:
    """Wall-clock seconds of a run, by purpose."""

    loading: float = 0.0
    physics: float = 0.0
    casting: float = 0.0
    writing: float = 0.0

    @contextmanager
    def on(self, purpose: Literal["loading", "physics", "casting", "writing"]) -> Iterator[None]:
        """Add the time that the body takes."""
        began = perf_counter()
        yield
        vars(self)[purpose] += perf_counter() - began

    def add(self, other: "Spent") -> None:
        """Add the times of another run, purpose by purpose."""
        for purpose, seconds in vars(other).items():
            vars(self)[purpose] += seconds

    def sentence(self) -> str:
        return ", ".join(f"{purpose} {seconds:.1f} s" for purpose, seconds in vars(self).items())


def initial_data(model: mujoco.MjModel, keyframe: str | None) -> mujoco.MjData:
    """Fresh data at the named keyframe, or at the model's own initial state."""
    data = mujoco.MjData(model)
    if keyframe is not None:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    return data


def step_count(model: mujoco.MjModel, duration: float) -> int:
    """The number of the model's timesteps in `duration` [s], at least one."""
    return max(1, round(duration / float(model.opt.timestep)))
