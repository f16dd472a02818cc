"""Refit of the trees over shapes on CUDA: one thread block per tree, all levels in one launch.

First the threads take the shapes, one each, so that none waits for the poses of many. Then they take the nodes, level
by level.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.trees.boxes import Box
from rigcast.kernels.trees.fit import Fit, fit_of_leaf, make_box, no_fit, with_child, with_own_box
from rigcast.kernels.trees.nodes import FOUR, NO_CHILD, Four

from .top_level import Refit, anchor_of, end_refit, span_box

BLOCK = wp.constant(128)
"""Threads of a block."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.func_native(on_cuda("__syncthreads(); return 0;"))
def meet() -> int:  # type: ignore[empty-body]
    """Synchronise the threads of a block: each waits for the others and sees what they have written."""


@wp.func_native(on_cuda("return nodes.data[at].child[j];"))
def child_of(nodes: wp.array[Four], at: int, j: int) -> int:  # type: ignore[empty-body]
    """Child j of node `at`, read alone, as below; Warp would copy the node."""


@wp.func_native(
    on_cuda("""
    const auto& node = nodes.data[at];
    return {node.lower_x[j], node.lower_y[j], node.lower_z[j]};
""")
)
def lower_end(nodes: wp.array[Four], at: int, j: int) -> wp.vec3:
    """Lower end of the box of child j."""


@wp.func_native(
    on_cuda("""
    const auto& node = nodes.data[at];
    return {node.upper_x[j], node.upper_y[j], node.upper_z[j]};
""")
)
def upper_end(nodes: wp.array[Four], at: int, j: int) -> wp.vec3:
    """Upper end of the box of child j."""


@wp.func_native(
    on_cuda("""
    auto& node = nodes.data[at];
    node.lower_x[j] = lower[0], node.lower_y[j] = lower[1], node.lower_z[j] = lower[2];
    node.upper_x[j] = upper[0], node.upper_y[j] = upper[1], node.upper_z[j] = upper[2];
    return 0;
""")
)
def set_ends(nodes: wp.array[Four], at: int, j: int, lower: wp.vec3, upper: wp.vec3) -> int:  # type: ignore[empty-body]
    """Set the ends of the box of child j."""


@wp.func
def set_box(g: Geometry, at: int, j: int, box: Box) -> None:
    set_ends(g.top_fours, at, j, box.lower, box.upper)


@wp.func
def fit_shapes(g: Geometry, span: int, thread: int, anchor: wp.vec3d) -> None:
    """Refit one thread's share of the boxes of shapes in a tree."""
    k = thread
    while k < FOUR * g.top_count:
        at = span * g.top_count + k / FOUR
        child = child_of(g.top_fours, at, k % FOUR)
        if child < 0 and child != NO_CHILD:
            set_box(g, at, k % FOUR, span_box(g, span, -1 - child, anchor))
        k += BLOCK


@wp.func
def fit_node(g: Geometry, at: int, fits: wp.array[Fit]) -> None:
    """Refit the boxes of children of node `at` that are nodes, and compute its Fit; its children must be refitted."""
    whole = no_fit()
    for j in range(FOUR):
        child = child_of(g.top_fours, at, j)
        if child >= 0:
            fit = fits[child]
            set_box(g, at, j, fit.box)
            whole = with_child(whole, fit)
        elif child != NO_CHILD:
            box = make_box(lower_end(g.top_fours, at, j), upper_end(g.top_fours, at, j))
            whole = with_child(whole, fit_of_leaf(box))
    fits[at] = with_own_box(whole)


@wp.func
def fit_tree(g: Geometry, span: int, thread: int, levels: wp.array[int], these: Refit) -> None:
    """Refit one thread's share of a tree, its shapes and then level by level."""
    anchor = anchor_of(g, span, these.anchor_shape)
    fit_shapes(g, span, thread, anchor)
    meet()
    for k in range(levels.shape[0] - 1):
        at = levels[levels.shape[0] - 2 - k] + thread
        while at < levels[levels.shape[0] - 1 - k]:
            fit_node(g, span * g.top_count + at, these.fits)
            at += BLOCK
        meet()
    if thread == 0:
        end_refit(g, span, anchor, these)


@wp.kernel
def refit_in_blocks(g: Geometry, levels: wp.array[int], these: Refit) -> None:
    """Refit every tree. levels: index of each level's first node, and the end of the last level."""
    fit_tree(g, wp.tid() / BLOCK, wp.tid() % BLOCK, levels, these)


@wp.kernel
def copy_to_trees_of_fours(nodes: wp.array[Four], top: wp.array[Four]) -> None:
    """Copy these nodes to every tree of `top`."""
    i = wp.tid()
    start = i / nodes.shape[0] * nodes.shape[0]
    node = nodes[i - start]
    for j in range(FOUR):
        if node.child[j] >= 0:
            node.child[j] = node.child[j] + start
    top[i] = node
