"""The nodes of trees of boxes over anything that has a box.

A tree is an array of nodes of up to eight children each. Node 0 of a tree is its root, children come after their
parents, and a child is another node (>= 0) or a leaf, written ~leaf (< 0). A box is kept as centre and half size; an
absent child, NO_CHILD, has half size -inf, which no ray meets.

On CUDA, where all rays go alone, a box is kept by its ends, which take them half as many operations: the lower one in
place of the centre, the upper one in place of the half size. That of an absent child is from +inf to -inf.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.vectors import larger

from .boxes import Box

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

WIDTH = wp.constant(8)
NO_CHILD = wp.constant(-(2**31))
FIRST_PATCH = wp.constant(2**27)
"""Leaves of triangle trees from here on are patches of height fields, those below it blocks of triangles."""
FIRST_PLOT = wp.constant(2**28)
"""Leaves from here on are plots of height fields, eight patches each: see rigcast.kernels.shapes.patches."""
OUTWARDS = wp.constant(1.0 + 4.0 * 2.0**-23)

vec8 = wp.types.vector(length=8, dtype=wp.float32)
vec8i = wp.types.vector(length=8, dtype=wp.int32)


@wp.struct
class Node:
    """Boxes of up to eight children, axis by axis, and what they are."""

    center_x: vec8
    center_y: vec8
    center_z: vec8
    half_x: vec8
    half_y: vec8
    half_z: vec8
    child: vec8i


@wp.func
def set_child(node: Node, j: int, box: Box, child: int) -> Node:
    """The node with child j and its box, rounded outwards; it may be infinite along any axis, or empty: never met."""
    node.center_x[j] = center_of(box.lower[0], box.upper[0])
    node.center_y[j] = center_of(box.lower[1], box.upper[1])
    node.center_z[j] = center_of(box.lower[2], box.upper[2])
    node.half_x[j] = half_of(box.lower[0], box.upper[0])
    node.half_y[j] = half_of(box.lower[1], box.upper[1])
    node.half_z[j] = half_of(box.lower[2], box.upper[2])
    node.child[j] = child
    return node


@wp.func
def center_of(lower: float, upper: float) -> float:
    middle = 0.5 * lower + 0.5 * upper
    return wp.where(wp.abs(middle) < wp.inf, middle, 0.0)


@wp.func
def half_of(lower: float, upper: float) -> float:
    middle = 0.5 * lower + 0.5 * upper
    half = larger(upper - middle, middle - lower) * OUTWARDS
    return wp.where(wp.abs(middle) < wp.inf, half, wp.where(lower < upper, wp.inf, -wp.inf))


@wp.func
def node_of(
    # the ends of the boxes of all eight children:
    lower_x: vec8,
    lower_y: vec8,
    lower_z: vec8,
    upper_x: vec8,
    upper_y: vec8,
    upper_z: vec8,
    child: vec8i,
) -> Node:
    """The node with these children, as `set_child` makes it one by one; the box of an absent one is empty."""
    center_x = vec8()
    center_y = vec8()
    center_z = vec8()
    half_x = vec8()
    half_y = vec8()
    half_z = vec8()
    for j in range(WIDTH):
        center_x[j] = center_of(lower_x[j], upper_x[j])
        center_y[j] = center_of(lower_y[j], upper_y[j])
        center_z[j] = center_of(lower_z[j], upper_z[j])
        half_x[j] = half_of(lower_x[j], upper_x[j])
        half_y[j] = half_of(lower_y[j], upper_y[j])
        half_z[j] = half_of(lower_z[j], upper_z[j])
    node = Node()
    node.center_x = center_x
    node.center_y = center_y
    node.center_z = center_z
    node.half_x = half_x
    node.half_y = half_y
    node.half_z = half_z
    node.child = child
    return node


@wp.func
def empty_node() -> Node:
    node = Node()
    for j in range(WIDTH):
        node.half_x[j] = -wp.inf
        node.half_y[j] = -wp.inf
        node.half_z[j] = -wp.inf
        node.child[j] = NO_CHILD
    return node


def moved_nodes(
    nodes: npt.NDArray[np.void], first_node: int, first_leaf: int, first_plot: int = 0
) -> npt.NDArray[np.void]:
    """The nodes of a tree whose root, first leaf and first plot stand at these places of longer arrays."""
    moved = nodes.copy()
    child = moved["child"]
    offset = np.where(child >= 0, first_node, np.where(~child >= FIRST_PLOT, -first_plot, -first_leaf))
    moved["child"] = np.where(child == NO_CHILD, NO_CHILD, child + offset)
    return moved


def by_ends(nodes: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The same nodes as CUDA has them. No box is smaller for rounding, as it was made around ends of float32."""
    ends = nodes.copy()
    for axis in "xyz":
        center, half = (nodes[f"{name}_{axis}"].astype(np.float64) for name in ("center", "half"))
        ends[f"center_{axis}"], ends[f"half_{axis}"] = center - half, center + half
    return ends


def join_trees(a: npt.NDArray[np.void], b: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The nodes of one tree of two over the same leaves, whose boxes are left to a refit.

    The children of both roots are those of one, so that it takes no node more to get to them; where they are too many,
    the smallest of a's share a node below.
    """
    own, others = _children_by_size(a[0]), _children_by_size(b[0])
    room = WIDTH - len(others)
    if room == 0:
        return np.concatenate([_node_over([1, 1 + len(a)]), moved_nodes(a, 1, 0), moved_nodes(b, 1 + len(a), 0)])
    is_full = len(own) > room
    first = 1 if is_full else 0  # what a's nodes move by
    from_a = np.where(own >= 0, own + first, own)
    from_b = np.where(others >= 0, others + first + len(a) - 1, others)
    if is_full:
        tops = [_node_over([*from_b, *from_a[: room - 1], 1]), _node_over(from_a[room - 1 :])]
    else:
        tops = [_node_over([*from_b, *from_a])]
    return np.concatenate([*tops, moved_nodes(a, first, 0)[1:], moved_nodes(b, first + len(a) - 1, 0)[1:]])


def _children_by_size(node: np.void) -> npt.NDArray[np.int32]:
    """Those that are there, the one with the largest box first."""
    x, y, z = (node[f"half_{axis}"] for axis in "xyz")
    order = np.argsort(-(x * y + y * z + z * x), kind="stable")
    child: npt.NDArray[np.int32] = node["child"][order]
    return child[child != NO_CHILD]


def _node_over(children: Sequence[int] | npt.NDArray[np.int32]) -> npt.NDArray[np.void]:
    """(1,) of Node with these children, without boxes."""
    node = empty_nodes(1)
    node["child"][0, : len(children)] = children
    return node


def empty_nodes(count: int) -> npt.NDArray[np.void]:
    """(count,) of Node without children."""
    nodes = struct_zeros(Node, count)
    for axis in "xyz":
        nodes[f"half_{axis}"] = -np.inf
    nodes["child"] = NO_CHILD
    return nodes


def struct_zeros(struct: Any, count: int) -> npt.NDArray[np.void]:
    """(count,) of a Warp struct, all fields 0, as numpy has it."""
    return np.zeros(count, dtype=_dtype(struct))


@cache
def _dtype(struct: Any) -> "np.dtype[np.void]":
    """Made once: numpy parses the types of all fields."""
    return np.dtype(struct.numpy_dtype())
