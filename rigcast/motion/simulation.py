"""Simulations run by commands: initial state, length, and time spent."""

from dataclasses import dataclass

import mujoco


@dataclass
class Spent:
    """Wall-clock seconds of a run, by purpose."""

    loading: float = 0.0
    stepping: float = 0.0
    sensing: float = 0.0
    writing: float = 0.0

    def sentence(self) -> str:
        return (
            f"loading {self.loading:.1f} s, physics {self.stepping:.1f} s, "
            f"casting {self.sensing:.1f} s, writing {self.writing:.1f} s"
        )


def initial_data(model: mujoco.MjModel, keyframe: str | None) -> mujoco.MjData:
    """Fresh data at the named keyframe, or at the model's own initial state."""
    data = mujoco.MjData(model)
    if keyframe is not None:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    return data


def step_count(model: mujoco.MjModel, duration: float) -> int:
    """The number of the model's timesteps in `duration` [s], at least one."""
    return max(1, round(duration / float(model.opt.timestep)))
