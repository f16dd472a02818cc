"""Trees of boxes over anything that has a box.

A tree is an array of nodes of up to eight children each. Node 0 of a tree is its root, children come after their
parents, and a child is another node (>= 0) or a leaf, written ~leaf (< 0). A box is kept as centre and half size; an
absent child, NO_CHILD, has half size -inf, which no ray meets.

Building runs on the CPU in two passes: a binary tree by the surface-area heuristic, then a collapse that opens the
largest boxes of a node until it has eight children.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from .binary_tree import BINS, BinaryTree, Bins, Boxes, box_of, build_binary
from .boxes import Box, half_area

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

WIDTH = wp.constant(8)
NO_CHILD = wp.constant(-(2**31))
OUTWARDS = wp.constant(1.0 + 4.0 * 2.0**-23)
STACK = 96
"""Entries of a traversal stack; no tree needs more."""

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
def child_to_open(tree: BinaryTree, members: vec8i, count: int, balanced: bool) -> int:
    """Which member has the largest box (balanced: the most boxes) and can be opened; -1 where all are leaves."""
    best = int(-1)
    best_size = float(-1.0)
    for j in range(count):
        b = members[j]
        if tree.left[b] > 0:
            size = wp.where(balanced, float(tree.count[b]), half_area(box_of(tree, b)))
            if size > best_size or best < 0:
                best = j
                best_size = size
    return best


@wp.func
def set_child(node: Node, j: int, box: Box, child: int) -> Node:
    """The node with child j and its box, rounded outwards; a box may be infinite, or empty and thus never met."""
    middle = 0.5 * box.lower + 0.5 * box.upper
    half = wp.max(box.upper - middle, middle - box.lower) * OUTWARDS
    if not wp.isfinite(middle):
        middle = wp.vec3(0.0, 0.0, 0.0)
        half = wp.where(box.lower[0] < box.upper[0], 1.0, -1.0) * wp.vec3(wp.inf, wp.inf, wp.inf)
    node.center_x[j] = middle[0]
    node.center_y[j] = middle[1]
    node.center_z[j] = middle[2]
    node.half_x[j] = half[0]
    node.half_y[j] = half[1]
    node.half_z[j] = half[2]
    node.child[j] = child
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


@wp.kernel
def collapse(
    tree: BinaryTree,
    balanced: bool,
    # scratch, for each node: the binary node it stands for, and how full a traversal stack may be there
    source: wp.array[int],
    occupancy: wp.array[int],
    # out:
    nodes: wp.array[Node],
    leaf_first: wp.array[int],
    leaf_count: wp.array[int],
    size: wp.array[int],
) -> None:
    """One thread. size: nodes, leaves, and the entries that a traversal stack needs."""
    source[0] = 0
    occupancy[0] = 1
    total = int(1)
    leaves = int(0)
    deepest = int(1)
    at = int(0)
    while at < total:
        members = vec8i()
        members[0] = source[at]
        count = int(1)
        opened = child_to_open(tree, members, count, balanced)
        while opened >= 0 and count < WIDTH:
            left = tree.left[members[opened]]
            members[opened] = left
            members[count] = left + 1
            count += 1
            opened = child_to_open(tree, members, count, balanced)
        room = occupancy[at] - 1 + count
        deepest = wp.max(deepest, room)
        node = empty_node()
        for j in range(count):
            b = members[j]
            child = int(0)
            if tree.left[b] > 0:
                child = total
                source[total] = b
                occupancy[total] = room
                total += 1
            else:
                child = -1 - leaves
                leaf_first[leaves] = tree.first[b]
                leaf_count[leaves] = tree.count[b]
                leaves += 1
            node = set_child(node, j, box_of(tree, b), child)
        nodes[at] = node
        at += 1
    size[0] = total
    size[1] = leaves
    size[2] = deepest


@dataclass(frozen=True)
class Tree:
    """A built tree, on the CPU.

    nodes: (nodes,) of Node. Leaf k holds the boxes order[leaf_first[k] : leaf_first[k] + leaf_count[k]].
    """

    nodes: npt.NDArray[np.void]
    order: npt.NDArray[np.int32]
    leaf_first: npt.NDArray[np.int32]
    leaf_count: npt.NDArray[np.int32]


def build_tree(lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32], leaf_size: int) -> Tree:
    """Build a tree over the boxes lower, upper (n, 3), with at most leaf_size boxes in a leaf; n may be 0."""
    if len(lower) == 0:
        return Tree(empty_nodes(1), *(np.zeros(0, np.int32) for _ in range(3)))
    # SAH trees of real meshes need about half of STACK; a balanced tree over 2^31 boxes needs 71
    tree, stack_needed = _build(lower, upper, leaf_size, balanced=False)
    if stack_needed >= STACK:  # one entry is left for the root that join_trees adds
        tree, _ = _build(lower, upper, leaf_size, balanced=True)
    return tree


def _build(
    lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32], leaf_size: int, balanced: bool
) -> tuple[Tree, int]:
    n = len(lower)
    boxes, binary, bins = Boxes(), BinaryTree(), Bins()
    boxes.lower, boxes.upper = (wp.array(a, dtype=wp.vec3, device="cpu", copy=True) for a in (lower, upper))
    boxes.order = wp.array(np.arange(n), dtype=int, device="cpu")
    binary.lower, binary.upper = _empty(2, 2 * n, wp.vec3)
    binary.first, binary.count, binary.left = _empty(3, 2 * n, int)
    bins.lower, bins.upper = _empty(2, (3, BINS), wp.vec3)
    (bins.count,) = _empty(1, (3, BINS), int)
    size = wp.zeros(3, dtype=int, device="cpu")
    (todo,) = _empty(1, n + 1, int)
    wp.launch(build_binary, 1, inputs=[boxes, leaf_size, balanced, bins, todo], outputs=[binary, size], device="cpu")
    n_binary = int(size.numpy()[0])
    (nodes,) = _empty(1, max(1, n_binary // 2), Node)
    source, occupancy, leaf_first, leaf_count = _empty(4, n_binary, int)
    outputs = [nodes, leaf_first, leaf_count, size]
    wp.launch(collapse, 1, inputs=[binary, balanced, source, occupancy], outputs=outputs, device="cpu")
    n_nodes, n_leaves, stack_needed = (int(x) for x in size.numpy())
    tree = Tree(
        nodes.numpy()[:n_nodes].copy(),
        boxes.order.numpy(),
        leaf_first.numpy()[:n_leaves].copy(),
        leaf_count.numpy()[:n_leaves].copy(),
    )
    return tree, stack_needed


def join_trees(a: npt.NDArray[np.void], b: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The nodes of one tree of two: a new root above both. Boxes of the root are left to a refit."""
    root = empty_nodes(1)
    root["child"][0, :2] = 1, 1 + len(a)
    moved = []
    for first, nodes in ((1, a), (1 + len(a), b)):
        child = nodes["child"]
        moved.append(nodes.copy())
        moved[-1]["child"] = np.where(child >= 0, child + first, child)
    return np.concatenate([root, *moved])


def _empty(count: int, shape: int | tuple[int, ...], dtype: type) -> list[wp.array]:
    return [wp.empty(shape, dtype=dtype, device="cpu") for _ in range(count)]


def empty_nodes(count: int) -> npt.NDArray[np.void]:
    """(count,) of Node without children."""
    nodes = struct_zeros(Node, count)
    for axis in "xyz":
        nodes[f"half_{axis}"] = -np.inf
    nodes["child"] = NO_CHILD
    return nodes


def struct_zeros(struct: Any, count: int) -> npt.NDArray[np.void]:
    """(count,) of a Warp struct, all fields 0, as numpy has it."""
    dtype: np.dtype[np.void] = struct.numpy_dtype()
    return np.zeros(count, dtype=dtype)
