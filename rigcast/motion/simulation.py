"""Simulations run by commands: initial state, divergence, and time spent."""

from dataclasses import dataclass

import mujoco
import numpy as np

from rigcast.sensors.errors import InputError

_DIVERGED = {
    mujoco.mjtWarning.mjWARN_BADQPOS: "position",
    mujoco.mjtWarning.mjWARN_BADQVEL: "velocity",
    mujoco.mjtWarning.mjWARN_BADQACC: "acceleration",
}


class Diverged(InputError):
    """A simulation has diverged; the message says when and where."""


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


def divergence(model: mujoco.MjModel, data: mujoco.MjData, time: float) -> str | None:
    """How the step from `time` [s] diverged, None if it did not.

    MuJoCo reacts to NaN and huge values with a warning and a reset to its initial state.
    """
    for warning, quantity in _DIVERGED.items():
        if data.warning[warning].number:
            index = data.warning[warning].lastinfo
            joints = model.jnt_qposadr if warning == mujoco.mjtWarning.mjWARN_BADQPOS else model.jnt_dofadr
            joint = int(np.searchsorted(joints, index, side="right")) - 1
            name = model.joint(joint).name or f"joint_{joint}"
            return f"the simulation diverged at t = {time:.6g} s: NaN, infinite or huge {quantity} of joint {name!r}"
    return None
