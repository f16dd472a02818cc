"""The walk through a tree of boxes by a ray on the CPU, from leaf to leaf.

A ray enters none of the boxes of a third of the nodes that it looks at, one of those of another third, or several. No
CPU foresees which, and to be wrong takes it as long as a node. So whether there is none or one is not asked by a
branch, and several are sorted without any.
"""

import warp as wp

from rigcast.kernels.trees.nodes import FIRST_PLOT, NO_CHILD, WIDTH, Node
from rigcast.kernels.trees.tree import STACK

from .native import on_cpu

ENTRIES = 2 * STACK + int(WIDTH)
"""Of a stack for both levels; a node is put on it with eight at once, of which some do not count."""
NUMBERS_OF_STACK = wp.constant(2 * ENTRIES)
"""A key of each entry, then a node of each."""

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
"""C++: a network that sorts eight, the largest first. Of a pair the first gets the larger one."""


# As integers, floats from 0 on are in the same order. A child that is entered becomes a key: its distance, but for the
# last three bits, which are its number. The limit has these three, so that no key that is as near is beyond it, and
# is 0 where it is -0. An entry of the stack is a key and the node whose child it is. The nearest child does not wait
# until all are sorted.
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
        if ((unsigned)at >= {int(FIRST_PLOT)}u) return (wp::uint64)top << 32 | (unsigned)at;
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
    """From node `at` on, or NO_CHILD, to the next leaf whose box is entered no farther than the limit, nearest first.

    Args:
        inverse, margin: of a ray from the origin, see rigcast.kernels.single.ray.
        limit: from 0 on.
        stack: (NUMBERS_OF_STACK,).
        top, bottom: how many entries the stack has, and how many of them are to stay.

    Returns:
        The leaf or plot, or NO_CHILD, in the lower half, and how many entries the stack has then in the upper one.
    """


@wp.func_native("return (int)(found >> 32);")
def top_of(found: wp.uint64) -> int:  # type: ignore[empty-body]
    """How many entries the stack has."""


@wp.func_native("return (int)(unsigned)found;")
def leaf_of(found: wp.uint64) -> int:  # type: ignore[empty-body]
    """The leaf or plot, as a node has it, or NO_CHILD."""
