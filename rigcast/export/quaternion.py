"""Rotations as quaternions."""

import mujoco
import numpy as np
from numpy.typing import NDArray


def quaternion(rotation: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation matrix (3, 3)."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rotation).reshape(9))
    w, x, y, z = quat.tolist()
    return w, x, y, z


def rotation(w: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    """(3, 3) of a unit quaternion."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.array([w, x, y, z]))
    return matrix.reshape(3, 3)
