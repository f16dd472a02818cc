"""Rotations by MuJoCo's own conversions: matrices, and quaternions w, x, y, z."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray


def quaternion(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The quaternion (4,) w, x, y, z of a rotation matrix (3, 3)."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(matrix).reshape(9))
    return quat


def rotation_matrix(quat: ArrayLike) -> NDArray[np.float64]:
    """The rotation matrix (3, 3) of a unit quaternion (4,) w, x, y, z."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, np.float64))
    return matrix.reshape(3, 3)
