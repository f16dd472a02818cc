"""Groups of rays that may share a packet: those of one origin and one firing."""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.rays.arrays import Rays


def groups_of(rays: Rays) -> npt.NDArray[np.int32] | None:
    """Group numbers (n,), equal for rays with the same origin and firing; None if all rays share both."""
    firing = None if rays.firing is None else rays.firing.numpy()
    if rays.origins.size == 1:
        return firing
    return same_rows(rays.origins.numpy() if firing is None else np.column_stack([rays.origins.numpy(), firing]))


def same_rows(rows: npt.NDArray[np.float64]) -> npt.NDArray[np.int32]:
    """Numbers (n,), from 0 on, equal for equal rows of (n, k), in lexicographic order of the rows."""
    order = np.lexsort(rows.T[::-1])  # faster than np.unique, which compares rows one by one
    is_other = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    number = np.zeros(len(rows), np.int32)
    number[order[1:]] = np.cumsum(is_other)
    return number


def repeat_firing(firing: wp.array | None, times: int) -> wp.array | None:
    """Firings (n times,) int32 for `times` consecutive rays in place of each; None if there is one firing."""
    if firing is None or times == 1:
        return firing
    return wp.array(np.repeat(firing.numpy(), times), dtype=int, device=firing.device)
