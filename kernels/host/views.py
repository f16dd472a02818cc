"""Views, in the shapes that frames show, of the arrays that kernels write."""

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

CAN_BE_ANY = bool(np.lib.NumpyVersion(wp.__version__) >= "1.19.0")
"""Whether Warp's generic kernels and `wp.map` accept subclasses of wp.array; 1.12 does not."""


class HostArray(wp.array):  # type: ignore[misc]
    """A CPU array with a fast `numpy()`; Warp's own takes as long as casting a few rays."""

    def numpy(self, **_: Any) -> npt.NDArray[Any]:
        return np.asarray(self)


def view_as(array: wp.array, dtype: Any, shape: tuple[int, ...]) -> wp.array:
    """A view of a contiguous array with this type and shape."""
    if array.device.is_cuda or array.size == 0 or not CAN_BE_ANY:
        return array.view(dtype).reshape(shape)
    same = HostArray(ptr=array.ptr, dtype=dtype, shape=shape, device=array.device)
    same._ref = array  # keeps the memory alive
    return same
