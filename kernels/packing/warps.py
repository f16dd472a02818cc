"""Rays in warps of neighbours, as CUDA casts them.

Threads of a warp run together, through all that any of them comes to, and neighbouring rays come to much the same.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from .sorting import CHUNK, Doubles, halved_to, in_parts

WARP = 32


@dataclass(frozen=True)
class Warps:
    """Rays on CUDA.

    order: (n,) int32, all of them, WARP neighbours after WARP neighbours.
    """

    order: wp.array


def sort_into_warps(directions: Doubles, device: wp.DeviceLike) -> Warps:
    """Sort rays from one origin with unit directions (n, 3)."""
    chunks = in_parts(np.arange(len(directions)), directions, CHUNK)
    whole = np.array([chunk for chunk in chunks if len(chunk) == CHUNK], np.int64).reshape(-1, CHUNK)
    rest = [rays for chunk in chunks if len(chunk) != CHUNK for rays in in_parts(chunk, directions, WARP)]
    order = np.concatenate([halved_to(whole, directions, WARP).reshape(-1), *rest])
    return Warps(wp.array(order, dtype=int, device=device))
