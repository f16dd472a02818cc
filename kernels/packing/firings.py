"""Rays that leave one after the other, or side by side, on their way into packets."""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.rays.arrays import Rays


def groups_of(rays: Rays) -> npt.NDArray[np.int32] | None:
    """(n,) the same number for rays that leave from one origin in one firing; None where all do."""
    firing = None if rays.firing is None else rays.firing.numpy()
    if rays.origins.size == 1:
        return firing
    return same_rows(rays.origins.numpy() if firing is None else np.column_stack([rays.origins.numpy(), firing]))


def same_rows(rows: npt.NDArray[np.float64]) -> npt.NDArray[np.int32]:
    """(n,) the same number for rows (n, k) that are the same, from 0 on, in the order of the rows."""
    order = np.lexsort(rows.T[::-1])  # in place of np.unique, which compares rows one by one
    is_other = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    number = np.zeros(len(rows), np.int32)
    number[order[1:]] = np.cumsum(is_other)
    return number


def repeat_firing(firing: wp.array | None, times: int) -> wp.array | None:
    """(n times,) int32: of so many rays that follow each other in place of each; None where there is one firing."""
    if firing is None or times == 1:
        return firing
    return wp.array(np.repeat(firing.numpy(), times), dtype=int, device=firing.device)
