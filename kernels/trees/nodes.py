"""The nodes of trees of boxes over anything that has a box.

A tree is an array of nodes with up to eight children each. Node 0 is the root and children come after their parents. A
child is another node (>= 0) or a leaf, stored as ~leaf (< 0). A box is stored as centre and half size. An absent child
is NO_CHILD with half size -inf, which no ray enters.

On CUDA, where all rays are cast singly, nodes have up to four children, whose boxes are stored by their ends. That
halves the operations of a single ray's test.
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
FOUR = wp.constant(4)
NO_CHILD = wp.constant(-(2**31))
FIRST_PATCH = wp.constant(2**27)
"""Leaves of triangle trees from this number on are patches of height fields; lower ones are blocks."""
FIRST_PLOT = wp.constant(2**28)
"""Leaves from this number on are not patches but plots, eight patches each; see rigcast.kernels.shapes.patches."""
OUTWARDS = wp.constant(1.0 + 4.0 * 2.0**-23)
"""Factor of half sizes that covers the rounding of a box's centre and half size."""

vec8 = wp.types.vector(length=8, dtype=wp.float32)
vec8i = wp.types.vector(length=8, dtype=wp.int32)


@wp.struct
class Node:
    """Boxes of up to eight children, as a structure of arrays, and their children as nodes or ~leaves."""

    center_x: vec8
    center_y: vec8
    center_z: vec8
    half_x: vec8
    half_y: vec8
    half_z: vec8
    child: vec8i


@wp.struct
class Four:
    """Boxes of up to four children by their ends, as a structure of arrays, and their children as nodes or ~leaves.

    The box of an absent child, NO_CHILD, extends from +inf to -inf.
    """

    lower_x: wp.vec4
    lower_y: wp.vec4
    lower_z: wp.vec4
    upper_x: wp.vec4
    upper_y: wp.vec4
    upper_z: wp.vec4
    child: wp.vec4i


@wp.func
def set_child(node: Node, j: int, box: Box, child: int) -> Node:
    """The node with child j and its box, rounded outwards. The box may be infinite along any axis; rays never enter an
    empty one."""
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
    """The node with these children, equal to eight calls of `set_child`; the box of an absent child must be empty."""
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
    """Copy the nodes with their child indices shifted: for arrays in which the tree's root, leaf 0 and plot 0 have
    these indices."""
    moved = nodes.copy()
    child = moved["child"]
    offset = np.where(child >= 0, first_node, np.where(~child >= FIRST_PLOT, -first_plot, -first_leaf))
    moved["child"] = np.where(child == NO_CHILD, NO_CHILD, child + offset)
    return moved


def ends_of(nodes: npt.NDArray[np.void]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """The ends (n, 8, 3) [m] of the children's boxes. Rounding shrinks no box: each was made around float32 ends."""
    center, half = (
        np.stack([nodes[f"{name}_{axis}"] for axis in "xyz"], axis=-1).astype(np.float64) for name in ("center", "half")
    )
    return (center - half).astype(np.float32), (center + half).astype(np.float32)


def join_trees(a: npt.NDArray[np.void], b: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Join two trees over the same array of leaves into one; its boxes must be refitted.

    The new root takes the children of both roots, so that paths do not get longer. If these are more than WIDTH, the
    smallest of a's children move to a node below the root. If b's root is full, the new root is over both roots.
    """
    own, others = _children_by_size(a[0]), _children_by_size(b[0])
    room = WIDTH - len(others)
    if room == 0:
        return np.concatenate([_node_over([1, 1 + len(a)]), moved_nodes(a, 1, 0), moved_nodes(b, 1 + len(a), 0)])
    is_full = len(own) > room
    first = 1 if is_full else 0  # offset of a's nodes
    from_a = np.where(own >= 0, own + first, own)
    from_b = np.where(others >= 0, others + first + len(a) - 1, others)
    if is_full:
        tops = [_node_over([*from_b, *from_a[: room - 1], 1]), _node_over(from_a[room - 1 :])]
    else:
        tops = [_node_over([*from_b, *from_a])]
    return np.concatenate([*tops, moved_nodes(a, first, 0)[1:], moved_nodes(b, first + len(a) - 1, 0)[1:]])


def _children_by_size(node: np.void) -> npt.NDArray[np.int32]:
    """The children of a node, those with the largest boxes first; absent ones are left out."""
    x, y, z = (node[f"half_{axis}"] for axis in "xyz")
    order = np.argsort(-(x * y + y * z + z * x), kind="stable")
    child: npt.NDArray[np.int32] = node["child"][order]
    return child[child != NO_CHILD]


def _node_over(children: Sequence[int] | npt.NDArray[np.int32]) -> npt.NDArray[np.void]:
    """(1,) of Node with these children; their boxes are not set."""
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
    """(count,) numpy array of a Warp struct, all fields 0."""
    return np.zeros(count, dtype=_dtype(struct))


@cache
def _dtype(struct: Any) -> "np.dtype[np.void]":
    """The struct's numpy dtype; cached, because numpy parses the types of all fields."""
    return np.dtype(struct.numpy_dtype())
