"""Recorded motions."""

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError


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
