"""A pool of the arrays of a sensor's frames, which are reused once nobody holds them."""

import math
from collections import deque
from sys import getrefcount

import warp as wp

from rigcast.kernels.hits.arrays import BYTES_PER_HIT, HitArrays

from .frame_arrays import FrameArrays
from .launches import Launches

_MOST = 8  # frames of a sensor whose arrays are remembered


class Pool:
    """The arrays of the last few frames of one sensor. Holding a frame holds all of its arrays.

    On the CPU all arrays share the launches of their first reading: if frames are all kept, nothing is read into their
    arrays again. On CUDA a graph may repeat those of any reading.
    """

    def __init__(self) -> None:
        self._last: deque[FrameArrays] = deque(maxlen=_MOST)
        self._launches = Launches()

    @property
    def free_bytes(self) -> int:
        """Bytes of the hits in arrays that nobody holds."""
        return sum(BYTES_PER_HIT * math.prod(self._last[k].shape) for k in range(len(self._last)) if self._is_free(k))

    def take(self, shape: tuple[int, ...], device: wp.Device) -> FrameArrays:
        """Arrays for a frame of this shape: those of the latest frame that nobody holds, or new ones.

        Arrays of another shape that nobody holds are released before new ones are allocated.
        """
        latest_first = range(len(self._last) - 1, -1, -1)
        for k in latest_first:
            if self._last[k].shape == shape and self._is_free(k):
                arrays = self._last[k]
                del self._last[k]
                arrays.start()
                break
        else:
            for k in latest_first:
                if self._is_free(k):
                    del self._last[k]
            hits = HitArrays.empty(math.prod(shape), device)
            arrays = FrameArrays(hits, shape, shared=self._launches if device.is_cpu else None)
        self._last.append(arrays)
        return arrays

    def _is_free(self, k: int) -> bool:
        return getrefcount(self._last[k]) == _ALONE and not self._last[k].held.by_others


_SOME = deque([object()])
_ALONE = getrefcount(_SOME[0])
"""Reference count of an object that only a deque holds."""
