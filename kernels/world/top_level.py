"""Trees over shapes: boxes of shapes at rest or in motion, and the refit of trees around them.

Each span has its own tree; all share the same topology. Boxes are relative to an anchor near the shapes, so that they
stay tight far from the world's origin.

The box of a moving shape contains it during the whole span. At the fraction f a point p of the shape, in its own frame,
is at x(f) + R(f) p. x(f) is on the chord between its ends. R(f) p moves on an arc of angle a at the distance r from the
axis. Its distance from its own chord at the same f is at most a^2 r / 8, the error of linear interpolation of a curve
whose second derivative is a^2 r. Points on chords stay within the box around both ends, which is widened by that.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.poses.moving import turn_between
from rigcast.kernels.poses.scope import (
    Pose,
    first_instant_of,
    first_of_world,
    is_somewhere,
    is_within_reach,
    pose_at,
    world_of,
)
from rigcast.kernels.trees.boxes import Box, empty_box, farthest_finite, join
from rigcast.kernels.trees.fit import Fit, fit_of_leaf, make_box, no_fit, with_child, with_own_box
from rigcast.kernels.trees.nodes import NO_CHILD, OUTWARDS, WIDTH, Node, node_of, vec8
from rigcast.kernels.vectors import to_float

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.func
def shape_box(pose: Pose, center: wp.vec3, half: wp.vec3, anchor: wp.vec3d) -> Box:
    """The box, relative to the anchor, of a local box under a pose; empty if the pose is not finite or beyond FARTHEST.

    An unbounded plane parallel to two axes gets a box infinite along these two only, so rays that leave it miss it.
    """
    if not is_somewhere(pose):
        return empty_box()
    rotation = pose.rotation
    middle = pose.position - anchor
    extent = wp.vec3d()
    for row in range(3):
        for column in range(3):
            size = wp.abs(rotation[row, column])
            middle[row] += rotation[row, column] * wp.float64(center[column])
            extent[row] += wp.where(size > wp.float64(0.0), size * wp.float64(half[column]), wp.float64(0.0))
    box = make_box(to_float(middle - extent), to_float(middle + extent))
    # rounded outwards by more than the two roundings above
    slack = (OUTWARDS - 1.0) * farthest_finite(box)
    return make_box(box.lower - wp.vec3(slack, slack, slack), box.upper + wp.vec3(slack, slack, slack))


@wp.func
def is_empty(box: Box) -> bool:
    return not (box.lower[0] <= box.upper[0])


@wp.func
def span_box(g: Geometry, span: int, shape: int, anchor: wp.vec3d) -> Box:
    """The box of a shape during a span, relative to the anchor; empty if it has none at either end."""
    shapes = g.kind.shape[0]
    entry = first_instant_of(g, span) + shape
    sized = first_of_world(g.size.shape[0], shapes, world_of(g.instants, span)) + shape
    center = g.center[sized]
    half = g.half[sized]
    box = shape_box(pose_at(g, entry), center, half, anchor)
    if g.instants == 1 or is_empty(box):
        return box
    end = shape_box(pose_at(g, entry + shapes), center, half, anchor)
    if is_empty(end):
        return end
    bulge = float(0.0)
    angle = float(wp.length(g.turn[span * shapes + shape]))
    if angle > 0.0:  # 0 * inf would be NaN
        bulge = OUTWARDS * 0.125 * angle * (angle * wp.length(wp.abs(center) + half))
    wider = wp.vec3(bulge, bulge, bulge)
    return join(make_box(end.lower - wider, end.upper + wider), box.lower - wider, box.upper + wider)


@wp.func
def anchor_of(g: Geometry, span: int, shape: int) -> wp.vec3d:
    """The position of this shape at the begin of the span; the previous anchor if that is not finite."""
    if shape < g.kind.shape[0]:
        position = pose_at(g, first_instant_of(g, span) + shape).position
        if is_within_reach(position):
            return position
    return g.anchor[span]


@wp.func
def fit_node(g: Geometry, span: int, at: int, anchor: wp.vec3d, fits: wp.array[Fit]) -> None:
    """Refit the boxes of a node to its children, which must have been refitted before."""
    children = g.top[at].child
    lower_x = vec8()
    lower_y = vec8()
    lower_z = vec8()
    upper_x = vec8()
    upper_y = vec8()
    upper_z = vec8()
    whole = no_fit()
    for j in range(WIDTH):
        child = children[j]
        fit = no_fit()
        if child >= 0:
            fit = fits[child]
        elif child != NO_CHILD:
            fit = fit_of_leaf(span_box(g, span, -1 - child, anchor))
        lower_x[j] = fit.box.lower[0]
        lower_y[j] = fit.box.lower[1]
        lower_z[j] = fit.box.lower[2]
        upper_x[j] = fit.box.upper[0]
        upper_y[j] = fit.box.upper[1]
        upper_z[j] = fit.box.upper[2]
        whole = with_child(whole, fit)
    g.top[at] = node_of(lower_x, lower_y, lower_z, upper_x, upper_y, upper_z, children)
    fits[at] = with_own_box(whole)


@wp.struct
class Refit:
    """Output of a refit: the Fit of every node of all trees, and each tree's total half area of boxes."""

    anchor_shape: int
    fits: wp.array[Fit]
    area: wp.array[float]


@wp.func
def end_refit(g: Geometry, span: int, anchor: wp.vec3d, these: Refit) -> None:
    """Write anchor, reach and area of a tree whose nodes have been refitted."""
    root = span * g.top_count
    g.anchor[span] = anchor
    g.top_reach[span] = these.fits[root].reach
    these.area[span] = these.fits[root].area


@wp.kernel
def refit(first: int, g: Geometry, these: Refit) -> None:
    """Refit one tree per thread, the last node first. For the CPU; CUDA uses rigcast.kernels.world.refit_in_blocks."""
    span = first + wp.tid()
    anchor = anchor_of(g, span, these.anchor_shape)
    root = span * g.top_count
    for k in range(g.top_count):
        fit_node(g, span, root + g.top_count - 1 - k, anchor, these.fits)
    end_refit(g, span, anchor, these)


@wp.kernel
def copy_to_trees(first: int, nodes: wp.array[Node], top: wp.array[Node]) -> None:
    """Copy these nodes to every tree of `top`."""
    i = first + wp.tid()
    start = i / nodes.shape[0] * nodes.shape[0]
    node = nodes[i - start]
    for j in range(WIDTH):
        if node.child[j] >= 0:
            node.child[j] = node.child[j] + start
    top[i] = node


@wp.struct
class ShapeBoxes:
    """The lower and upper ends of the boxes of shapes."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]


@wp.kernel
def first_boxes(first: int, g: Geometry, anchor_shape: int, boxes: ShapeBoxes) -> None:
    """Write the box of each shape in the first span in which it has one; empty if it never has."""
    shape = first + wp.tid()
    box = empty_box()
    span = int(0)
    while is_empty(box) and span < g.anchor.shape[0]:
        box = span_box(g, span, shape, anchor_of(g, span, anchor_shape))
        span += 1
    boxes.lower[shape] = box.lower
    boxes.upper[shape] = box.upper


@wp.kernel
def turn_shapes(first: int, g: Geometry) -> None:
    """Write the rotation vector of each shape during each span."""
    i = first + wp.tid()
    shapes = g.kind.shape[0]
    entry = first_instant_of(g, i / shapes) + i % shapes
    g.turn[i] = turn_between(pose_at(g, entry).rotation, pose_at(g, entry + shapes).rotation)
