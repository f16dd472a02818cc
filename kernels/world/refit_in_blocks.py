"""Refit of the trees over shapes on CUDA: one thread block per tree, all levels in one launch.

For each level, threads first take its children, one each, then its nodes. So no thread waits for the poses of many
shapes. Boxes are stored by their ends, see rigcast.kernels.trees.nodes.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.trees.boxes import empty_box
from rigcast.kernels.trees.fit import Fit, fit_of_leaf, make_box, no_fit, with_child, with_own_box
from rigcast.kernels.trees.nodes import NO_CHILD, WIDTH, Node

from .top_level import Refit, anchor_of, end_refit, span_box

BLOCK = wp.constant(128)
"""Threads of a block."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.func_native(on_cuda("__syncthreads(); return 0;"))
def meet() -> int:  # type: ignore[empty-body]
    """Synchronise the threads of a block: each waits for the others and sees what they have written."""


@wp.func_native(on_cuda("return nodes.data[at].child[j];"))
def child_of(nodes: wp.array[Node], at: int, j: int) -> int:  # type: ignore[empty-body]
    """Child j of node `at`, read alone, as below; Warp would copy the node."""


@wp.func_native(
    on_cuda("""
    const auto& node = nodes.data[at];
    return {node.center_x[j], node.center_y[j], node.center_z[j]};
""")
)
def lower_end(nodes: wp.array[Node], at: int, j: int) -> wp.vec3:
    """Lower end of the box of child j."""


@wp.func_native(
    on_cuda("""
    const auto& node = nodes.data[at];
    return {node.half_x[j], node.half_y[j], node.half_z[j]};
""")
)
def upper_end(nodes: wp.array[Node], at: int, j: int) -> wp.vec3:
    """Upper end of the box of child j."""


@wp.func_native(
    on_cuda("""
    auto& node = nodes.data[at];
    node.center_x[j] = lower[0], node.center_y[j] = lower[1], node.center_z[j] = lower[2];
    node.half_x[j] = upper[0], node.half_y[j] = upper[1], node.half_z[j] = upper[2];
    return 0;
""")
)
def set_ends(nodes: wp.array[Node], at: int, j: int, lower: wp.vec3, upper: wp.vec3) -> int:  # type: ignore[empty-body]
    """Set the ends of the box of child j."""


@wp.func
def fit_child(g: Geometry, span: int, at: int, j: int, anchor: wp.vec3d, fits: wp.array[Fit]) -> None:
    """Refit the box of child j of node `at`; a child that is a node must have been refitted before."""
    child = child_of(g.top, at, j)
    box = empty_box()
    if child >= 0:
        box = fits[child].box
    elif child != NO_CHILD:
        box = span_box(g, span, -1 - child, anchor)
    set_ends(g.top, at, j, box.lower, box.upper)


@wp.func
def fit_around(g: Geometry, at: int, fits: wp.array[Fit]) -> None:
    """Compute the Fit of node `at`, whose children must have been refitted before."""
    whole = no_fit()
    for j in range(WIDTH):
        child = child_of(g.top, at, j)
        if child >= 0:
            whole = with_child(whole, fits[child])
        elif child != NO_CHILD:
            whole = with_child(whole, fit_of_leaf(make_box(lower_end(g.top, at, j), upper_end(g.top, at, j))))
    fits[at] = with_own_box(whole)


@wp.func
def fit_levels(g: Geometry, span: int, thread: int, levels: wp.array[int], these: Refit) -> None:
    """Refit one thread's share of a tree, level by level."""
    anchor = anchor_of(g, span, these.anchor_shape)
    root = span * g.top_count
    for k in range(levels.shape[0] - 1):
        begin = levels[levels.shape[0] - 2 - k]
        end = levels[levels.shape[0] - 1 - k]
        at = begin * WIDTH + thread
        while at < end * WIDTH:
            fit_child(g, span, root + at / WIDTH, at % WIDTH, anchor, these.fits)
            at += BLOCK
        meet()
        at = begin + thread
        while at < end:
            fit_around(g, root + at, these.fits)
            at += BLOCK
        meet()
    if thread == 0:
        end_refit(g, span, anchor, these)


@wp.kernel
def refit_in_blocks(g: Geometry, levels: wp.array[int], these: Refit) -> None:
    """Refit every tree. levels: index of each level's first node, and the end of the last level."""
    fit_levels(g, wp.tid() / BLOCK, wp.tid() % BLOCK, levels, these)
