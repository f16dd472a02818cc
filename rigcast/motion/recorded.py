"""Recorded motions: read from a file, and played back without physics."""

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError

from .steps import Control, Step, no_control


def read_motion(path: Path, model: mujoco.MjModel | None = None) -> NDArray[np.float64]:
    """The positions (rows, nq) in an NPY file. Raises InputError for anything else, and for those of another model."""
    try:
        rows = np.asarray(np.load(path, allow_pickle=False), dtype=np.float64)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: not an NPY file of numbers: {error}") from None
    if rows.ndim != 2 or len(rows) < 2 or not np.isfinite(rows).all():
        raise InputError(f"{path}: got an array of shape {rows.shape}, expected 2 rows or more of nq finite numbers")
    if model is not None and rows.shape[1] != model.nq:
        raise InputError(f"{path}: got rows of {rows.shape[1]} numbers, expected nq = {model.nq} of the model")
    return rows


def playback(
    rows: NDArray[np.float64],
    rate_hz: float,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    adjust: Control = no_control,
) -> Step:
    """Playback of a recorded motion. Sets `data` to the first row now; between rows joints move at constant speed.

    Args:
        rows: (n, nq), a qpos in each, see `read_motion`.
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
