"""Axis-aligned boxes."""

import warp as wp

from rigcast.kernels.vectors import larger, norm1, smaller


@wp.struct
class Box:
    lower: wp.vec3
    upper: wp.vec3


@wp.func
def empty_box() -> Box:
    box = Box()
    box.lower = wp.vec3(wp.inf, wp.inf, wp.inf)
    box.upper = wp.vec3(-wp.inf, -wp.inf, -wp.inf)
    return box


@wp.func
def join(a: Box, lower: wp.vec3, upper: wp.vec3) -> Box:
    box = Box()
    for k in range(3):
        box.lower[k] = smaller(a.lower[k], lower[k])
        box.upper[k] = larger(a.upper[k], upper[k])
    return box


@wp.func
def farthest_finite(box: Box) -> float:
    """The largest finite |coordinate| of a box, 0 if there is none."""
    farthest = float(0.0)
    for k in range(3):
        farthest = larger(farthest, larger(if_finite(wp.abs(box.lower[k])), if_finite(wp.abs(box.upper[k]))))
    return farthest


@wp.func
def if_finite(size: float) -> float:
    """The number `size` >= 0, or 0 in place of inf and NaN."""
    return wp.where(size < wp.inf, size, 0.0)


@wp.func
def is_finite(box: Box) -> bool:
    return norm1(box.lower) + norm1(box.upper) < wp.inf


@wp.func
def half_area(box: Box) -> float:
    extent = box.upper - box.lower
    return extent[0] * extent[1] + extent[1] * extent[2] + extent[2] * extent[0]
