"""Sorting of rays into warps of neighbours, for CUDA.

The threads of a warp run through everything that any of them visits, and neighbouring rays visit much the same.
"""

import numpy as np
import warp as wp

from rigcast.kernels.rays.coherent import Warps

from .sorting import CHUNK, Doubles, halved_to, in_chunks, in_parts

WARP = 32
EVEN = (1.0, 1.0, 1.0)
LEVEL = (1.0, 1.0, 6.0)
"""Weights for a lidar: its rays of one elevation have similar lengths, so few wait long for the slowest of the warp."""


def sort_into_warps(directions: Doubles, device: wp.DeviceLike, weights: tuple[float, float, float] = EVEN) -> Warps:
    """Sort rays from one origin with unit directions (n, 3). weights: of differences along x, y and z."""
    directions = directions * weights
    chunks, others = in_chunks(np.arange(len(directions)), directions, CHUNK)
    rest = [rays for chunk in others for rays in in_parts(chunk, directions, WARP)]
    order = np.concatenate([halved_to(chunks, directions, WARP).reshape(-1), *rest])
    return Warps(wp.array(order, dtype=int, device=device))
