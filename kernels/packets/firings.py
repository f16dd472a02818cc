"""Rays that leave one after the other, on their way into packets."""

import numpy as np
import warp as wp

from .sorting import Packets, sort_into_packets


def sort_rays(directions: wp.array, firing: wp.array | None) -> Packets:
    """Sort rays with unit directions (n,) vec3d; firing (n,) int32 says which of several each belongs to."""
    return sort_into_packets(directions.numpy(), None if firing is None else firing.numpy())


def repeat_firing(firing: wp.array | None, times: int) -> wp.array | None:
    """(n times,) int32: of so many rays that follow each other in place of each; None where there is one firing."""
    if firing is None or times == 1:
        return firing
    return wp.array(np.repeat(firing.numpy(), times), dtype=int, device=firing.device)
