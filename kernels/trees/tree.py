"""Top-down construction of trees over boxes, on the CPU.

The boxes of a node are split in two; then the part with the largest box is split again, until there are eight parts or
all fit into leaves. A large tree is built in two rounds: first a coarse tree in one thread, whose leaves hold many
boxes; then the subtree of each of these leaves, in all threads.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.slices import launch_over_rays

from .boxes import half_area
from .nodes import NO_CHILD, WIDTH, Node, empty_node, empty_nodes, moved_nodes, set_child, struct_zeros, vec8, vec8i
from .splits import BINS, Bin, Boxes, Extent, box_of, extent_of, split_boxes

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

STACK = 72
"""Entries of a traversal stack; no tree needs more."""
LARGE = 2**15
"""Number of boxes from which a tree is built in two rounds, whatever the number of threads."""
PARTS = 16
"""A leaf of the coarse tree holds at most 1 / PARTS of all boxes."""


@wp.struct
class Run:
    """Boxes first, first + 1, ... first + count - 1."""

    first: int
    count: int


@wp.struct
class Pending:
    """A node still to be made of a run of boxes. room: most entries of a traversal stack when it pops the node."""

    node: int
    run: Run
    room: int


@wp.struct
class PartialNode:
    """A node under construction: the runs of boxes that become its children; the one of largest size is split next."""

    node: Node
    members: int
    first: vec8i
    count: vec8i
    size: vec8


@wp.struct
class TreeSize:
    """Size of a tree: numbers of nodes and leaves, and the entries that its traversal stack needs."""

    nodes: int
    leaves: int
    stack: int


@wp.func
def make_run(first: int, count: int) -> Run:
    run = Run()
    run.first = first
    run.count = count
    return run


@wp.func
def make_pending(node: int, run: Run, room: int) -> Pending:
    pending = Pending()
    pending.node = node
    pending.run = run
    pending.room = room
    return pending


@wp.func
def with_member(partial: PartialNode, j: int, run: Run, extent: Extent, balanced: bool) -> PartialNode:
    partial.first[j] = run.first
    partial.count[j] = run.count
    partial.size[j] = wp.where(balanced, float(run.count), half_area(box_of(extent.box)))
    return partial


@wp.func
def member_to_split(partial: PartialNode, run_size: int) -> int:
    """Index of the largest member among those with more than run_size boxes; -1 if there is none."""
    best = int(-1)
    best_size = float(-1.0)
    for j in range(partial.members):
        if partial.count[j] > run_size:  # noqa: SIM102, as Warp evaluates both sides of an `and`
            if partial.size[j] > best_size or best < 0:
                best = j
                best_size = partial.size[j]
    return best


@wp.struct
class Build:
    """Input, scratch and output of `build_runs`. A struct: Warp compiles a kernel twice if arrays are its arguments."""

    boxes: Boxes
    runs: wp.array[Run]
    leaf_size: int
    run_size: int
    balanced: bool
    bins: wp.array[Bin]  # 3 * BINS for each run
    extents: wp.array[Extent]  # WIDTH for each run
    pending: wp.array[Pending]  # (boxes,)
    # out, (boxes,); entries of a run begin at the index of its first box:
    nodes: wp.array[Node]
    leaves: wp.array[Run]
    sizes: wp.array[TreeSize]  # (runs,)


@wp.func
def split_run(build: Build, thread: int, run: Run) -> PartialNode:
    """Split a run into up to eight; runs of at most run_size boxes are not split further."""
    boxes = build.boxes
    extents = build.extents
    at = thread * WIDTH
    partial = PartialNode()
    extents[at] = extent_of(boxes, run.first, run.count)
    partial = with_member(partial, 0, run, extents[at], build.balanced)
    partial.members = 1
    j = member_to_split(partial, build.run_size)
    while j >= 0 and partial.members < WIDTH:
        first = partial.first[j]
        count = partial.count[j]
        halves = split_boxes(
            boxes, first, count, extents[at + j].centers, build.leaf_size, build.balanced, build.bins, thread * 3 * BINS
        )
        left = make_run(first, halves.left_count)
        right = make_run(first + halves.left_count, count - halves.left_count)
        partial = with_member(partial, j, left, halves.left, build.balanced)
        partial = with_member(partial, partial.members, right, halves.right, build.balanced)
        extents[at + j] = halves.left
        extents[at + partial.members] = halves.right
        partial.members += 1
        j = member_to_split(partial, build.run_size)
    partial.node = empty_node()
    for m in range(partial.members):
        partial.node = set_child(partial.node, m, box_of(extents[at + m].box), NO_CHILD)
    return partial


@wp.kernel
def build_runs(first_thread: int, build: Build) -> None:
    """Build the tree of one run per thread, down to leaves of at most run_size boxes.

    Construction is depth-first, so that the boxes of a subtree stay in the cache.
    """
    thread = first_thread + wp.tid()
    runs = build.runs
    pending = build.pending
    nodes = build.nodes
    leaves = build.leaves
    sizes = build.sizes
    base = runs[thread].first
    size = TreeSize()
    size.nodes = 1
    pending[base] = make_pending(0, runs[thread], 1)
    left_to_do = int(1)
    while left_to_do > 0:
        left_to_do -= 1
        parent = pending[base + left_to_do]
        partial = split_run(build, thread, parent.run)
        room = parent.room - 1 + partial.members
        size.stack = wp.max(size.stack, room)
        for j in range(partial.members):
            run = make_run(partial.first[j], partial.count[j])
            if run.count > build.run_size:
                partial.node.child[j] = size.nodes
                pending[base + left_to_do] = make_pending(size.nodes, run, room)
                size.nodes += 1
                left_to_do += 1
            else:
                partial.node.child[j] = -1 - size.leaves
                leaves[base + size.leaves] = run
                size.leaves += 1
        nodes[base + parent.node] = partial.node
    sizes[thread] = size


@dataclass(frozen=True)
class Tree:
    """A built tree, on the CPU.

    nodes: (nodes,) of Node. Leaf k holds the boxes order[leaf_first[k] : leaf_first[k] + leaf_count[k]].
    """

    nodes: npt.NDArray[np.void]
    order: npt.NDArray[np.int32]
    leaf_first: npt.NDArray[np.int32]
    leaf_count: npt.NDArray[np.int32]


@dataclass(frozen=True)
class _Part:
    """The tree of one run: nodes of Node, leaves of Run."""

    nodes: npt.NDArray[np.void]
    leaves: npt.NDArray[np.void]


def build_tree(lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32], leaf_size: int, spare: int = 0) -> Tree:
    """Build a tree over the boxes lower, upper (n, 3), with at most leaf_size boxes in a leaf; n may be 0.

    spare: entries of a traversal's stack to leave free, for nodes that will be added.
    """
    if len(lower) == 0:
        return Tree(empty_nodes(1), *(np.zeros(0, np.int32) for _ in range(3)))
    # SAH trees of real meshes need up to 56; a balanced tree over 2^27 leaves needs 64
    tree, stack_needed = _build(lower, upper, leaf_size, balanced=False)
    if stack_needed > STACK - spare:
        tree, _ = _build(lower, upper, leaf_size, balanced=True)
    return tree


def _build(
    lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32], leaf_size: int, balanced: bool
) -> tuple[Tree, int]:
    """Return the tree and an upper bound of the entries that its traversal stack needs."""
    n = len(lower)
    boxes = Boxes()
    boxes.lower, boxes.upper = (wp.array(a, dtype=wp.vec3, device="cpu", copy=True) for a in (lower, upper))
    boxes.order = wp.array(np.arange(n), dtype=int, device="cpu")
    run_size = leaf_size if n < LARGE else max(leaf_size, n // PARTS)
    whole = struct_zeros(Run, 1)
    whole["count"] = n
    (part,), stack = _build_runs(boxes, whole, leaf_size, run_size, balanced)
    if run_size > leaf_size:
        parts, deeper = _build_runs(boxes, part.leaves, leaf_size, leaf_size, balanced)
        part, stack = _with_subtrees(part.nodes, parts), stack - 1 + deeper
    return Tree(part.nodes, boxes.order.numpy(), part.leaves["first"].copy(), part.leaves["count"].copy()), stack


def _build_runs(
    boxes: Boxes, runs: npt.NDArray[np.void], leaf_size: int, run_size: int, balanced: bool
) -> tuple[list[_Part], int]:
    """Build the tree of each run; return them and the most stack entries that any of them needs."""
    n, build = boxes.order.size, Build()
    build.boxes, build.runs = boxes, wp.array(runs, dtype=Run, device="cpu")
    build.leaf_size, build.run_size, build.balanced = leaf_size, run_size, balanced
    build.bins = wp.empty(len(runs) * 3 * BINS, dtype=Bin, device="cpu")
    build.extents = wp.empty(len(runs) * WIDTH, dtype=Extent, device="cpu")
    build.pending, build.nodes, build.leaves = (wp.empty(n, dtype=kind, device="cpu") for kind in (Pending, Node, Run))
    build.sizes = wp.empty(len(runs), dtype=TreeSize, device="cpu")
    launch_over_rays(build_runs, len(runs), [build], [], "cpu", slice_size=1)
    nodes, leaves, sizes = build.nodes.numpy(), build.leaves.numpy(), build.sizes.numpy()
    parts = [
        _Part(nodes[first : first + node_count].copy(), leaves[first : first + leaf_count].copy())
        for (first, _), (node_count, leaf_count, _) in zip(runs.tolist(), sizes.tolist(), strict=True)
    ]
    return parts, int(sizes["stack"].max())


def _with_subtrees(nodes: npt.NDArray[np.void], parts: list[_Part]) -> _Part:
    """The tree of these nodes with leaf k replaced by part k."""
    first_node = len(nodes) + np.cumsum([0, *(len(part.nodes) for part in parts)])
    first_leaf = np.cumsum([0, *(len(part.leaves) for part in parts)])
    child = nodes["child"]
    is_leaf = (child < 0) & (child != NO_CHILD)
    child[is_leaf] = first_node[~child[is_leaf]]
    moved = [moved_nodes(part.nodes, *at) for part, *at in zip(parts, first_node[:-1], first_leaf[:-1], strict=True)]
    return _Part(np.concatenate([nodes, *moved]), np.concatenate([part.leaves for part in parts]))
