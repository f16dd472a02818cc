"""The tree over shapes: boxes of the shapes where they stand now, and the tree refitted around them.

Everything is relative to an anchor near the shapes, so that boxes stay tight far from the world's origin.
"""

import warp as wp

from .geometry import FARTHEST
from .tree import NO_CHILD, OUTWARDS, WIDTH, Box, Node, empty_box, half_area, join, set_child
from .vectors import to_float

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

REBUILD_RATIO = 1.5
"""A tree is built anew when the area of its boxes has grown this much by refitting."""


@wp.func
def make_box(lower: wp.vec3, upper: wp.vec3) -> Box:
    box = Box()
    box.lower = lower
    box.upper = upper
    return box


@wp.func
def shape_box(position: wp.vec3d, rotation: wp.mat33d, center: wp.vec3, half: wp.vec3, anchor: wp.vec3d) -> Box:
    """The box, relative to the anchor, of a local box under a pose.

    It is infinite on all sides where the half size is on any, and empty where the pose is not finite or too far away.
    """
    middle = position - anchor
    extent = wp.vec3d()
    for row in range(3):
        for column in range(3):
            middle[row] += rotation[row, column] * wp.float64(center[column])
            if rotation[row, column] != wp.float64(0.0):
                extent[row] += wp.abs(rotation[row, column]) * wp.float64(half[column])
    if not (wp.max(wp.abs(position)) <= wp.float64(FARTHEST) and wp.isfinite(middle) and wp.isfinite(rotation)):
        return empty_box()
    everywhere = wp.vec3(wp.inf, wp.inf, wp.inf)
    if not wp.isfinite(half):
        return make_box(-everywhere, everywhere)
    lower = to_float(middle - extent)
    upper = to_float(middle + extent)
    # rounded outwards by more than the two roundings above
    slack = (OUTWARDS - 1.0) * wp.max(wp.max(wp.abs(lower)), wp.max(wp.abs(upper)))
    return make_box(lower - wp.vec3(slack, slack, slack), upper + wp.vec3(slack, slack, slack))


@wp.kernel
def shape_boxes(
    # shapes:
    position: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    center: wp.array[wp.vec3],
    half: wp.array[wp.vec3],
    anchor: wp.array[wp.vec3d],
    # out, one per shape:
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
) -> None:
    i = wp.tid()
    box = shape_box(position[i], rotation[i], center[i], half[i], anchor[0])
    lower[i] = box.lower
    upper[i] = box.upper


@wp.func
def child_box(
    child: int,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    node_lower: wp.array[wp.vec3],
    node_upper: wp.array[wp.vec3],
) -> Box:
    if child >= 0:
        return make_box(node_lower[child], node_upper[child])
    return make_box(lower[-1 - child], upper[-1 - child])


@wp.func
def largest_coordinate(box: Box) -> float:
    """0 for a box that is empty or infinite."""
    if not (wp.isfinite(box.lower) and wp.isfinite(box.upper)):
        return 0.0
    return wp.max(wp.max(wp.abs(box.lower)), wp.max(wp.abs(box.upper)))


@wp.kernel
def refit(
    # boxes of the leaves, and of nodes (scratch):
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    node_lower: wp.array[wp.vec3],
    node_upper: wp.array[wp.vec3],
    # in and out:
    nodes: wp.array[Node],
    # out:
    area: wp.array[float],  # (1,) sum over all finite boxes
    reach: wp.array[float],  # (1,) largest |coordinate| of a finite box
) -> None:
    """One thread: fit the boxes of all nodes to those of the leaves, children first; leaf ~k has box k."""
    total = float(0.0)
    farthest = float(0.0)
    for k in range(nodes.shape[0]):
        at = nodes.shape[0] - 1 - k
        node = nodes[at]
        whole = empty_box()
        for j in range(WIDTH):
            child = node.child[j]
            if child != NO_CHILD:
                box = child_box(child, lower, upper, node_lower, node_upper)
                node = set_child(node, j, box, child)
                whole = join(whole, box.lower, box.upper)
                farthest = wp.max(farthest, largest_coordinate(box))
                if largest_coordinate(box) > 0.0:
                    total += half_area(box)
        node_lower[at] = whole.lower
        node_upper[at] = whole.upper
        nodes[at] = node
    area[0] = total
    reach[0] = farthest
