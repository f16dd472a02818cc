"""Arrays on a device that are written from the host repeatedly."""

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp


class Upload:
    """A device array `array`, (count,) of vectors or matrices, to write from the host."""

    def __init__(self, count: int, dtype: Any, device: wp.Device) -> None:
        self.array = wp.empty(count, dtype=dtype, device=device)
        self._view = self.array.numpy() if device.is_cpu else None

    def write(self, values: npt.NDArray[np.floating[Any]]) -> None:
        """Copy these values, in the array's order."""
        if self._view is not None:
            if values.shape != self._view.shape:
                self._view = self._view.reshape(values.shape)
            self._view[...] = values
        else:
            whole = np.ascontiguousarray(values).reshape(-1, *self.array.dtype._shape_)
            wp.copy(self.array, wp.array(whole, dtype=self.array.dtype, device="cpu", copy=False))
