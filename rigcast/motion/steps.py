"""One step of a simulation: physics, alone or under a controller."""

from collections.abc import Callable

import mujoco
import numpy as np

from rigcast.sensors.errors import InputError

from .functions import UserFunction

Step = Callable[[], None]
"""Takes MjData one timestep further."""
Control = Callable[[mujoco.MjData], object]
"""Writes `ctrl` before a step."""

_DIVERGED = {
    mujoco.mjtWarning.mjWARN_BADQPOS: "position",
    mujoco.mjtWarning.mjWARN_BADQVEL: "velocity",
    mujoco.mjtWarning.mjWARN_BADQACC: "acceleration",
}


class Diverged(InputError):
    """A simulation has diverged; the message says when and where."""


def no_control(_data: mujoco.MjData) -> None:
    """Leave `ctrl` as it is."""


def physics(model: mujoco.MjModel, data: mujoco.MjData, control: Control = no_control) -> Step:
    """A step that calls `control`, then mj_step. It raises Diverged when the simulation diverges."""

    def step() -> None:
        control(data)
        time = data.time
        mujoco.mj_step(model, data)
        _refuse_divergence(model, data, time)

    return step


def _refuse_divergence(model: mujoco.MjModel, data: mujoco.MjData, time: float) -> None:
    """Raise Diverged if the step from `time` [s] did: MuJoCo then warns and resets to its initial state."""
    for warning, quantity in _DIVERGED.items():
        if data.warning[warning].number:
            index = data.warning[warning].lastinfo
            joints = model.jnt_qposadr if warning == mujoco.mjtWarning.mjWARN_BADQPOS else model.jnt_dofadr
            joint = int(np.searchsorted(joints, index, side="right")) - 1
            name = model.joint(joint).name or f"joint_{joint}"
            place = f"NaN, infinite or huge {quantity} of joint {name!r}"
            raise Diverged(f"the simulation diverged at t = {time:.6g} s: {place}")


def control_of(function: UserFunction, model: mujoco.MjModel, seed: int) -> Control:
    """The controller that a user's function returns for a model and a seed.

    Raises FunctionFault, here or when it is called, for a function that raises or returns the wrong thing.
    """
    control = function(model, seed)
    if not callable(control):
        raise function.wrong(f"got {type(control).__name__}, expected a function of the MjData")
    returned = function.returned(control)

    def controlled(data: mujoco.MjData) -> None:
        value = returned(data)
        if value is not None:
            got = type(value).__name__
            raise returned.wrong(f"got {got} from the function of the MjData, expected None: it writes data.ctrl")

    return controlled
