"""Refits: the boxes of a tree are recomputed, children first, while its topology stays the same."""

import warp as wp

from rigcast.kernels.vectors import larger

from .boxes import Box, empty_box, farthest_finite, half_area, is_finite, join

REBUILD_RATIO = 1.5
"""A tree is rebuilt when refits have increased the total area of its boxes by this factor."""


@wp.struct
class Fit:
    """Refit of a subtree: its box, the total half area of its finite boxes, the largest finite |coordinate| in it."""

    box: Box
    area: float
    reach: float


@wp.func
def make_box(lower: wp.vec3, upper: wp.vec3) -> Box:
    box = Box()
    box.lower = lower
    box.upper = upper
    return box


@wp.func
def no_fit() -> Fit:
    fit = Fit()
    fit.box = empty_box()
    return fit


@wp.func
def fit_of_leaf(box: Box) -> Fit:
    fit = Fit()
    fit.box = box
    return with_own_box(fit)


@wp.func
def with_own_box(fit: Fit) -> Fit:
    """The fit with its own box counted: its area only if the box is finite, its coordinates where they are finite."""
    box = fit.box
    if is_finite(box):
        fit.area += half_area(box)
    fit.reach = larger(fit.reach, farthest_finite(box))
    return fit


@wp.func
def with_child(fit: Fit, child: Fit) -> Fit:
    fit.box = join(fit.box, child.box.lower, child.box.upper)
    fit.area += child.area
    fit.reach = larger(fit.reach, child.reach)
    return fit
