"""Rays that leave one after the other, or side by side, on their way into packets."""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.rays import Rays


def groups_of(rays: Rays) -> npt.NDArray[np.int32] | None:
    """(n,) the same number for rays that leave from one origin in one firing; None where all do."""
    firing = None if rays.firing is None else rays.firing.numpy()
    if rays.origins.size == 1:
        return firing
    where = rays.origins.numpy() if firing is None else np.column_stack([rays.origins.numpy(), firing])
    _, group = np.unique(where, axis=0, return_inverse=True)
    return group.reshape(-1).astype(np.int32)


def repeat_firing(firing: wp.array | None, times: int) -> wp.array | None:
    """(n times,) int32: of so many rays that follow each other in place of each; None where there is one firing."""
    if firing is None or times == 1:
        return firing
    return wp.array(np.repeat(firing.numpy(), times), dtype=int, device=firing.device)
