"""Options for what moves the robot while a command simulates."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Annotated

import mujoco
import numpy as np
import typer
from numpy.typing import NDArray

from rigcast.motion.functions import UserFunction, find_function
from rigcast.motion.recorded import playback, read_motion
from rigcast.motion.steps import Step, control_of, physics
from rigcast.sensors.errors import InputError

Controller = Annotated[
    str | None,
    typer.Option(
        metavar="MODULE:FUNCTION",
        help="function of the MjModel and the seed that returns one of the MjData, called before every step, which "
        "writes its ctrl; the module may be beside the rig",
    ),
]
Motion = Annotated[
    Path | None,
    typer.Option(help="NPY file of (rows, nq) positions that are played back, without physics"),
]
MotionRate = Annotated[float | None, typer.Option(help="rows of --motion per second [Hz]")]


@dataclass(frozen=True, eq=False)
class Moving:
    """The source of a robot's motion: a user's controller, recorded positions, or neither: physics alone."""

    function: UserFunction | None = None
    rows: NDArray[np.float64] | None = None
    rate_hz: float = 0.0

    @property
    def lasts(self) -> float | None:
        """Duration of the recorded positions [s]; None without any."""
        return None if self.rows is None else (len(self.rows) - 1) / self.rate_hz

    def duration(self, wanted: float | None) -> float | None:
        """Time to simulate [s]: `--duration`, else the duration of the motion; None without either.

        Raises InputError if `--duration` is not positive, or longer than the motion.
        """
        if wanted is None:
            return self.lasts
        if not (isfinite(wanted) and wanted > 0.0):
            raise InputError(f"--duration: got {wanted}, expected a positive number of seconds")
        if self.lasts is not None and wanted > self.lasts + 1e-9:
            raise InputError(f"--duration: got {wanted:g} s, but the motion lasts {self.lasts:g} s")
        return wanted

    def step(self, model: mujoco.MjModel, data: mujoco.MjData, seed: int) -> Step:
        """A function that advances `data` by one timestep; sets `data` to the first recorded positions."""
        if self.rows is not None:
            return playback(self.rows, self.rate_hz, model, data)
        if self.function is not None:
            return physics(model, data, control_of(self.function, model, seed))
        return physics(model, data)


def moving(
    rig: Path, model: mujoco.MjModel, controller: str | None, motion: Path | None, rate_hz: float | None
) -> Moving:
    """The motion from the options. Raises InputError if they conflict or name something that does not exist."""
    if controller is not None and motion is not None:
        raise InputError("--controller and --motion: expected one of them")
    if (motion is None) != (rate_hz is None):
        raise InputError("--motion and --motion-rate: expected both, a file and its rows per second")
    if motion is not None and rate_hz is not None:
        if not (isfinite(rate_hz) and rate_hz > 0.0):
            raise InputError(f"--motion-rate: got {rate_hz:g}, expected a positive number of rows per second")
        return Moving(rows=read_motion(motion, model), rate_hz=rate_hz)
    if controller is not None:
        if controller.count(":") != 1 or not all(controller.split(":")):
            raise InputError(f"--controller: got {controller!r}, expected MODULE:FUNCTION")
        return Moving(function=find_function(rig.parent, controller))
    return Moving()
