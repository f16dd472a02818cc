"""One step of a simulation: physics under a controller, or a recorded motion without physics."""

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from .functions import UserFunction
from .simulation import Diverged, divergence

Step = Callable[[], None]
"""Takes MjData one timestep further."""
Control = Callable[[mujoco.MjData], object]
"""Writes `ctrl` before a step."""


def no_control(_data: mujoco.MjData) -> None:
    """Leave `ctrl` as it is."""


def physics(model: mujoco.MjModel, data: mujoco.MjData, control: Control = no_control) -> Step:
    """A step that calls `control`, then mj_step. It raises Diverged when the simulation diverges."""

    def step() -> None:
        control(data)
        time = data.time
        mujoco.mj_step(model, data)
        reason = divergence(model, data, time)
        if reason is not None:
            raise Diverged(reason)

    return step


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


def playback(
    rows: NDArray[np.float64],
    rate_hz: float,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    adjust: Control = no_control,
) -> Step:
    """Playback of a recorded motion. Sets `data` to the first row now; between rows joints move at constant speed.

    Args:
        rows: (n, nq), a qpos in each, see rigcast.motion.recorded.
        rate_hz: rows per second.
        adjust: called after every change of qpos.
    """
    began = data.time
    data.qpos[:] = rows[0]
    adjust(data)

    def step() -> None:
        data.time += model.opt.timestep
        at = (data.time - began) * rate_hz
        row = min(int(at), len(rows) - 2)
        # on the manifold of qpos, where quaternions rotate at constant speed
        velocity = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, velocity, 1.0, rows[row], rows[row + 1])
        data.qpos[:] = rows[row]
        mujoco.mj_integratePos(model, data.qpos, velocity, at - row)
        adjust(data)

    return step
