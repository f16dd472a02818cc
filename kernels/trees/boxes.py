"""Boxes along the axes."""

import warp as wp


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
    box.lower = wp.min(a.lower, lower)
    box.upper = wp.max(a.upper, upper)
    return box


@wp.func
def farthest_finite(box: Box) -> float:
    """The largest finite |coordinate|, 0 if there is none."""
    farthest = float(0.0)
    for k in range(3):
        if wp.isfinite(box.lower[k]):
            farthest = wp.max(farthest, wp.abs(box.lower[k]))
        if wp.isfinite(box.upper[k]):
            farthest = wp.max(farthest, wp.abs(box.upper[k]))
    return farthest


@wp.func
def half_area(box: Box) -> float:
    extent = box.upper - box.lower
    return extent[0] * extent[1] + extent[1] * extent[2] + extent[2] * extent[0]
