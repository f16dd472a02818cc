"""Trees of boxes over anything that has a box, built by the surface-area heuristic.

A tree is an array of nodes of up to eight children each. Node 0 of a tree is its root, children come after their
parents, and a child is another node (>= 0) or a leaf, written ~leaf (< 0). A box is kept as centre and half size; an
absent child, NO_CHILD, has half size -inf, which no ray meets.

Building runs on the CPU in two passes: a binary tree by binned SAH (Wald, "On fast construction of SAH-based bounding
volume hierarchies", 2007), then a collapse that opens the largest boxes of a node until it has eight children.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

WIDTH = wp.constant(8)
BINS = wp.constant(16)
NO_CHILD = wp.constant(-(2**31))
OUTWARDS = wp.constant(1.0 + 4.0 * 2.0**-23)
STACK = 96
"""Entries of a traversal stack; no tree needs more."""

vec8 = wp.types.vector(length=8, dtype=wp.float32)
vec16 = wp.types.vector(length=16, dtype=wp.float32)
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


@wp.struct
class BinaryTree:
    """Nodes over order[first : first + count]; children at left and left + 1, or none where left is 0."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]
    first: wp.array[int]
    count: wp.array[int]
    left: wp.array[int]


@wp.struct
class Box:
    lower: wp.vec3
    upper: wp.vec3


@wp.struct
class Boxes:
    """What a tree is built over, and the order in which its leaves hold it."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]
    order: wp.array[int]


@wp.struct
class Bins:
    """(3, BINS): the boxes whose centres fall into each of the bins along each axis."""

    lower: wp.array2d[wp.vec3]
    upper: wp.array2d[wp.vec3]
    count: wp.array2d[int]


@wp.struct
class Grid:
    """Where the bins of a node are: bin = (centre - base) * scale."""

    base: wp.vec3
    scale: wp.vec3


@wp.struct
class Split:
    """Bins up to last_left_bin of the axis go left; axis -1 where no split was found."""

    axis: int
    last_left_bin: int
    cost: float


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
def half_area(box: Box) -> float:
    extent = box.upper - box.lower
    return extent[0] * extent[1] + extent[1] * extent[2] + extent[2] * extent[0]


@wp.func
def center(boxes: Boxes, i: int) -> wp.vec3:
    return 0.5 * boxes.lower[i] + 0.5 * boxes.upper[i]


@wp.func
def bin_of(grid: Grid, axis: int, point: wp.vec3) -> int:
    at = (point[axis] - grid.base[axis]) * grid.scale[axis]
    # kept in range as a float, NaN to 0: what int() makes of a float beyond its range is undefined
    return int(wp.where(at > 0.0, wp.min(at, float(BINS - 1)), 0.0))


@wp.func
def bounds(boxes: Boxes, first: int, count: int) -> Box:
    box = empty_box()
    for i in range(first, first + count):
        box = join(box, boxes.lower[boxes.order[i]], boxes.upper[boxes.order[i]])
    return box


@wp.func
def center_bounds(boxes: Boxes, first: int, count: int) -> Box:
    box = empty_box()
    for i in range(first, first + count):
        point = center(boxes, boxes.order[i])
        box = join(box, point, point)
    return box


@wp.func
def grid_over(centers: Box) -> Grid:
    grid = Grid()
    grid.base = centers.lower
    for axis in range(3):
        extent = centers.upper[axis] - centers.lower[axis]
        grid.scale[axis] = wp.where(extent > 0.0, float(BINS) / extent, 0.0)
    return grid


@wp.func
def fill_bins(boxes: Boxes, first: int, count: int, grid: Grid, bins: Bins) -> None:
    for axis in range(3):
        for b in range(BINS):
            bins.lower[axis, b] = wp.vec3(wp.inf, wp.inf, wp.inf)
            bins.upper[axis, b] = wp.vec3(-wp.inf, -wp.inf, -wp.inf)
            bins.count[axis, b] = 0
    for i in range(first, first + count):
        p = boxes.order[i]
        point = center(boxes, p)
        for axis in range(3):
            b = bin_of(grid, axis, point)
            bins.lower[axis, b] = wp.min(bins.lower[axis, b], boxes.lower[p])
            bins.upper[axis, b] = wp.max(bins.upper[axis, b], boxes.upper[p])
            bins.count[axis, b] = bins.count[axis, b] + 1


@wp.func
def side_cost(box: Box, count: int) -> float:
    """Area x count, the expected cost of one side of a split; +inf for a side without boxes."""
    return wp.where(count > 0, half_area(box) * float(count), wp.inf)


@wp.func
def best_split_along(axis: int, bins: Bins, best: Split) -> Split:
    right_cost = vec16()
    box = empty_box()
    count = int(0)
    for k in range(BINS - 1):
        b = BINS - 1 - k
        box = join(box, bins.lower[axis, b], bins.upper[axis, b])
        count += bins.count[axis, b]
        right_cost[b] = side_cost(box, count)
    box = empty_box()
    count = int(0)
    for b in range(BINS - 1):
        box = join(box, bins.lower[axis, b], bins.upper[axis, b])
        count += bins.count[axis, b]
        cost = side_cost(box, count) + right_cost[b + 1]
        if cost < best.cost:
            best.cost = cost
            best.axis = axis
            best.last_left_bin = b
    return best


@wp.func
def partition(boxes: Boxes, first: int, count: int, grid: Grid, split: Split) -> int:
    """Move the boxes left of the split to the front; return how many they are."""
    i = int(first)
    j = int(first + count - 1)
    while i <= j:
        p = boxes.order[i]
        if bin_of(grid, split.axis, center(boxes, p)) <= split.last_left_bin:
            i += 1
        else:
            boxes.order[i] = boxes.order[j]
            boxes.order[j] = p
            j -= 1
    return i - first


@wp.func
def split_by_sah(boxes: Boxes, first: int, count: int, bins: Bins) -> int:
    """Reorder the boxes along the split of least cost; return how many lie left of it, 0 if there is none."""
    grid = grid_over(center_bounds(boxes, first, count))
    fill_bins(boxes, first, count, grid, bins)
    split = Split()
    split.axis = -1
    split.cost = wp.inf
    for axis in range(3):
        split = best_split_along(axis, bins, split)
    if split.axis < 0:
        return 0
    return partition(boxes, first, count, grid, split)


@wp.kernel
def build_binary(
    boxes: Boxes,
    leaf_size: int,
    balanced: bool,
    # scratch:
    bins: Bins,
    # out:
    tree: BinaryTree,
    size: wp.array[int],
) -> None:
    """One thread. Nodes are settled in the order in which they are made, so parents come before their children.

    Where the heuristic finds no split, and everywhere if balanced, a node is halved by count instead.
    """
    tree.first[0] = 0
    tree.count[0] = boxes.order.shape[0]
    total = int(1)
    node = int(0)
    while node < total:
        first = tree.first[node]
        count = tree.count[node]
        box = bounds(boxes, first, count)
        tree.lower[node] = box.lower
        tree.upper[node] = box.upper
        tree.left[node] = 0
        if count > leaf_size:
            left_count = int(0)
            if not balanced:
                left_count = split_by_sah(boxes, first, count, bins)
            if left_count == 0 or left_count == count:
                left_count = count / 2
            for side in range(2):
                tree.first[total + side] = first + side * left_count
                tree.count[total + side] = wp.where(side == 0, left_count, count - left_count)
            tree.left[node] = total
            total += 2
        node += 1
    size[0] = total


@wp.func
def box_of(tree: BinaryTree, node: int) -> Box:
    box = Box()
    box.lower = tree.lower[node]
    box.upper = tree.upper[node]
    return box


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
    boxes.lower, boxes.upper = (wp.array(a, dtype=wp.vec3, device="cpu", copy=False) for a in (lower, upper))
    boxes.order = wp.array(np.arange(n), dtype=int, device="cpu")
    binary.lower, binary.upper = _empty(2, 2 * n, wp.vec3)
    binary.first, binary.count, binary.left = _empty(3, 2 * n, int)
    bins.lower, bins.upper = _empty(2, (3, BINS), wp.vec3)
    (bins.count,) = _empty(1, (3, BINS), int)
    size = wp.zeros(3, dtype=int, device="cpu")
    wp.launch(build_binary, 1, inputs=[boxes, leaf_size, balanced, bins], outputs=[binary, size], device="cpu")
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
