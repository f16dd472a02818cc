"""Arrays as frames show them, in the memory of those that kernels write."""

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

CAN_BE_ANY = bool(np.lib.NumpyVersion(wp.__version__) >= "1.19.0")
"""Whether Warp's generic kernels and `wp.map` take arrays of a class made of Warp's own: 1.12 does not."""


class HostArray(wp.array):  # type: ignore[misc]
    """An array on the CPU that numpy sees at once: Warp's way to it takes as long as a cast of a few rays."""

    def numpy(self, **_: Any) -> npt.NDArray[Any]:
        return np.asarray(self)


def view_as(array: wp.array, dtype: Any, shape: tuple[int, ...]) -> wp.array:
    """An array without gaps as one of this type and shape, without a copy."""
    if array.device.is_cuda or array.size == 0 or not CAN_BE_ANY:
        return array.view(dtype).reshape(shape)
    same = HostArray(ptr=array.ptr, dtype=dtype, shape=shape, device=array.device)
    same._ref = array  # which keeps the memory
    return same
