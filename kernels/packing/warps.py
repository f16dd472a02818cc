"""Rays in warps of neighbours, as CUDA casts them.

Threads of a warp run together, through all that any of them comes to, and neighbouring rays come to much the same.
"""

import numpy as np
import warp as wp

from rigcast.kernels.rays.coherent import Warps

from .sorting import CHUNK, Doubles, halved_to, in_parts

WARP = 32
EVEN = (1.0, 1.0, 1.0)
LEVEL = (1.0, 1.0, 6.0)
"""Of a lidar, rays of one elevation go about as far as each other, and none waits long for the slowest of its warp."""


def sort_into_warps(directions: Doubles, device: wp.DeviceLike, weights: tuple[float, float, float] = EVEN) -> Warps:
    """Sort rays from one origin with unit directions (n, 3). weights: of distances along x, y and z."""
    directions = directions * weights
    chunks = in_parts(np.arange(len(directions)), directions, CHUNK)
    whole = np.array([chunk for chunk in chunks if len(chunk) == CHUNK], np.int64).reshape(-1, CHUNK)
    rest = [rays for chunk in chunks if len(chunk) != CHUNK for rays in in_parts(chunk, directions, WARP)]
    order = np.concatenate([halved_to(whole, directions, WARP).reshape(-1), *rest])
    return Warps(wp.array(order, dtype=int, device=device))
