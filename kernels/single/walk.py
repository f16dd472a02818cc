"""Traversal of a BVH by a single ray on the CPU, from one leaf to the next.

Of the nodes that a ray visits, about a third have no child that it enters, a third have one, a third have several. No
branch predictor foresees which, and a misprediction costs as much as a node. So the cases of none and one are told
apart without a branch, and several children are sorted without one.
"""

import warp as wp

from rigcast.kernels.trees.nodes import NO_CHILD, WIDTH, Node
from rigcast.kernels.trees.tree import STACK

from .native import on_cpu

ENTRIES = 2 * STACK + int(WIDTH)
"""Entries of a stack for both levels; a node pushes eight at once, some of them beyond the new height."""
NUMBERS_OF_STACK = wp.constant(2 * ENTRIES)
"""Length of the stack's array: the keys of all entries, then their nodes."""

_SORT = "".join(
    f"""
        {{
            const ints other = __builtin_shufflevector(far, far, {", ".join(map(str, partner))});
            const ints is_first = {{{", ".join(str(-int(i < j)) for i, j in enumerate(partner))}}};
            far = is_first ? larger(far, other) : smaller(far, other);
        }}"""
    for partner in (
        (1, 0, 3, 2, 5, 4, 7, 6),
        (2, 3, 0, 1, 6, 7, 4, 5),
        (0, 2, 1, 3, 4, 6, 5, 7),
        (4, 5, 6, 7, 0, 1, 2, 3),
        (0, 1, 4, 5, 2, 3, 6, 7),
        (0, 2, 1, 4, 3, 6, 5, 7),
    )
)
"""C++: a sorting network for eight numbers, the largest first. The first of a pair gets the larger number."""


# Non-negative floats compare in the same order as their bits do as integers. The key of an entered child is its
# distance with the last three bits replaced by the child's number. The limit has these three bits set, so that no key
# at the same distance is beyond it; -0 becomes 0. A stack entry is a key and the node whose child it is. The nearest
# child is found by a reduction and does not wait for the sort.
@wp.func_native(
    on_cpu(f"""
    int *const keys = stack.data, *const parents = stack.data + {ENTRIES};
    const int no_child = {int(NO_CHILD)};
    const int last = larger(__builtin_bit_cast(int, limit), 0) | 7;
    const float ix = inverse[0], iy = inverse[1], iz = inverse[2];
    const float sx = __builtin_fabsf(ix), sy = __builtin_fabsf(iy), sz = __builtin_fabsf(iz);
    const float ox = -origin[0] * ix, oy = -origin[1] * iy, oz = -origin[2] * iz;
    const float mx = margin * sx, my = margin * sy, mz = margin * sz;
    const auto child_of = [&](int node, int key) {{ return nodes.data[node].child.c[key & 7]; }};
    while (true) {{
        while (at == no_child && top > bottom) {{
            --top;
            if (keys[top] <= last) at = child_of(parents[top], keys[top]);
        }}
        if (at < 0) return (wp::uint64)top << 32 | (unsigned)at;
        const float* const node = &nodes.data[at].center_x.c[0];
        const auto row = [&](int i) -> floats {{ return *(const floats_anywhere*)(node + 8 * i); }};
        const floats half_x = row(3);
        const floats cx = row(0) * ix + ox, cy = row(1) * iy + oy, cz = row(2) * iz + oz;
        const floats hx = half_x * sx + mx, hy = row(4) * sy + my, hz = row(5) * sz + mz;
        const floats enter = larger(larger(cx - hx, cy - hy), larger(cz - hz, (floats)0.0f));
        const floats leave = smaller(smaller(cx + hx, cy + hy), smaller(cz + hz, (floats)limit));
        // the last condition keeps absent children out whatever rays and boxes are
        const ints is_entered = (enter <= leave) & (half_x >= (floats)0.0f);
        const int entered = bits_of(is_entered);
        if ((entered & (entered - 1)) == 0) {{
            const bool is_left = top > bottom;
            const int under = is_left ? top - 1 : top, over = is_left ? parents[under] : at;
            const int waiting = child_of(over, keys[under]);
            const int popped = is_left && keys[under] <= last ? waiting : no_child;
            const int only = child_of(at, __builtin_ctz(entered | 256));
            at = __builtin_unpredictable(entered == 0) ? popped : only;
            top = __builtin_unpredictable(entered == 0) ? under : top;
            continue;
        }}
        const ints lane = {{0, 1, 2, 3, 4, 5, 6, 7}};
        const ints key = (__builtin_bit_cast(ints, enter) & ~7) | lane;
        const int nearest = __builtin_reduce_min(is_entered ? key : (ints)0x7fffffff);
        ints far = is_entered ? key : (ints)-1;
        {_SORT}
        *(ints_anywhere*)(keys + top) = far;
        *(ints_anywhere*)(parents + top) = (ints)at;
        top += __builtin_popcount(entered) - 1;
        at = child_of(at, nearest);
    }}
""")
)
def next_leaf(
    nodes: wp.array[Node],
    at: int,
    origin: wp.vec3,
    inverse: wp.vec3,
    margin: float,
    limit: float,
    stack: wp.array[int],
    top: int,
    bottom: int,
) -> wp.uint64:
    """Go on to the next leaf whose box the ray enters no farther than the limit; children are taken nearest first.

    Args:
        at: node to go on from; NO_CHILD to pop one from the stack.
        inverse, margin: of the ray, see rigcast.kernels.single.ray.
        limit: distance [m], at least 0.
        stack: (NUMBERS_OF_STACK,).
        top: height of the stack.
        bottom: height down to which entries may be popped.

    Returns:
        The leaf as ~leaf, or NO_CHILD if there is none, in the lower 32 bits; the new height in the upper 32 bits.
    """


@wp.func_native("return (int)(found >> 32);")
def top_of(found: wp.uint64) -> int:  # type: ignore[empty-body]
    """Height of the stack, from next_leaf's result."""


@wp.func_native("return (int)(unsigned)found;")
def leaf_of(found: wp.uint64) -> int:  # type: ignore[empty-body]
    """The leaf as ~leaf, or NO_CHILD, from next_leaf's result."""
