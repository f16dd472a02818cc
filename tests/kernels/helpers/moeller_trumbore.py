"""Rays against triangles in float64 numpy, with no code of the kernels.

Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", Journal of Graphics Tools 2(1), 1997.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]


def dot(a: Doubles, b: Doubles) -> Doubles:
    return np.einsum("...i,...i", a, b)


def norm(a: Doubles) -> Doubles:
    return np.linalg.norm(a, axis=-1)


def moeller_trumbore(origin: Any, direction: Any, v0: Any, v1: Any, v2: Any) -> tuple[Doubles, Doubles]:
    """Distances and barycentric coordinates at which rays meet the planes of triangles.

    Args:
        origin, direction, v0, v1, v2: (..., 3), broadcast.

    Returns:
        t (...) in multiples of the direction, and the barycentric coordinates (..., 3) of v0, v1, v2 there; NaN or inf
        where ray and plane are parallel.
    """
    o, d, a, b, c = (np.asarray(x, np.float64) for x in (origin, direction, v0, v1, v2))
    e1, e2, s = b - a, c - a, o - a
    p, q = np.cross(d, e2), np.cross(s, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / dot(e1, p)
        u, v, t = dot(s, p) * inverse, dot(d, q) * inverse, dot(e2, q) * inverse
        return t, np.stack([1.0 - u - v, u, v], axis=-1)
