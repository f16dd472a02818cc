"""The walk through a tree of boxes by a CPU, from leaf to leaf."""

import warp as wp

from rigcast.kernels.trees.nodes import Node
from rigcast.kernels.trees.tree import STACK

ENTRIES = wp.constant(2 * STACK + 8)
NUMBERS = wp.constant(2 * (2 * STACK + 8))
"""Of a stack for both levels."""


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    #pragma clang fp contract(fast)
    typedef float floats __attribute__((ext_vector_type(8)));
    typedef int ints __attribute__((ext_vector_type(8)));
    typedef bool bools __attribute__((ext_vector_type(8)));
    typedef float floats_anywhere __attribute__((ext_vector_type(8), aligned(4)));
    typedef int ints_anywhere __attribute__((ext_vector_type(8), aligned(4)));
    const auto larger = [](floats a, floats b) {{ return a > b ? a : b; }};
    const auto smaller = [](floats a, floats b) {{ return a < b ? a : b; }};
    const int no_child = (int)0x80000000;
    int* const keys = stack.data;
    int* const parents = keys + {ENTRIES};
    const int last = __builtin_bit_cast(int, limit) | 7;
    const float ix = inverse[0], iy = inverse[1], iz = inverse[2];
    const float sx = __builtin_fabsf(ix), sy = __builtin_fabsf(iy), sz = __builtin_fabsf(iz);
    const float ox = -origin[0] * ix, oy = -origin[1] * iy, oz = -origin[2] * iz;
    const float wider = 1.25f * margin, mx = wider * sx, my = wider * sy, mz = wider * sz;
    const ints lane = {{0, 1, 2, 3, 4, 5, 6, 7}};
    while (true) {{
        while (at == no_child && top > bottom) {{
            --top;
            const int key = keys[top];
            if (key <= last) at = nodes.data[parents[top]].child.c[key & 7];
        }}
        if (at < 0) return (wp::uint64)(unsigned)top << 32 | (unsigned)at;
        const float* const node = (const float*)&nodes.data[at];
        const auto row = [&](int i) -> floats {{ return *(const floats_anywhere*)(node + 8 * i); }};
        const floats half_x = row(3);
        const floats cx = row(0) * ix + ox, cy = row(1) * iy + oy, cz = row(2) * iz + oz;
        const floats hx = half_x * sx + mx, hy = row(4) * sy + my, hz = row(5) * sz + mz;
        const floats enter = larger(larger(cx - hx, cy - hy), larger(cz - hz, (floats)0.0f));
        const floats leave = smaller(smaller(cx + hx, cy + hy), smaller(cz + hz, (floats)limit));
        const ints is_entered = (enter <= leave) & (half_x >= (floats)0.0f);
        const ints key = (__builtin_bit_cast(ints, enter) & ~7) | lane;
        const bools entered = __builtin_convertvector(is_entered, bools);
        unsigned char bits;
        __builtin_memcpy(&bits, &entered, 1);
        const int parent = at;
        const int* const child = (const int*)(node + 48);
        if ((bits & (bits - 1)) == 0) {{
            // branch-free: none or one, neither of which a CPU foresees
            const bool is_left = top > bottom, is_none = bits == 0;
            const int under = is_left ? top - 1 : top;
            const int waiting = keys[under], over = is_left ? parents[under] : parent;
            const int waited = nodes.data[over].child.c[waiting & 7];
            const int only = child[__builtin_ctz(bits | 256) & 7];
            const int popped = is_left && waiting <= last ? waited : no_child;
            at = __builtin_unpredictable(is_none) ? popped : only;
            top = __builtin_unpredictable(is_none) ? under : top;
            continue;
        }}
        const ints near = is_entered ? key : (ints)0x7fffffff;
        const int nearest = __builtin_reduce_min(near);
        at = child[nearest & 7];
        ints far = is_entered ? key : (ints)-1;
        const auto order = [](ints v, ints other, ints is_first) -> ints {{
            return is_first ? (v > other ? v : other) : (v < other ? v : other);
        }};
        far = order(far, __builtin_shufflevector(far, far, 1, 0, 3, 2, 5, 4, 7, 6), (ints){{-1, 0, -1, 0, -1, 0, -1, 0}});
        far = order(far, __builtin_shufflevector(far, far, 2, 3, 0, 1, 6, 7, 4, 5), (ints){{-1, -1, 0, 0, -1, -1, 0, 0}});
        far = order(far, __builtin_shufflevector(far, far, 0, 2, 1, 3, 4, 6, 5, 7), (ints){{-1, -1, 0, 0, -1, -1, 0, 0}});
        far = order(far, __builtin_shufflevector(far, far, 4, 5, 6, 7, 0, 1, 2, 3), (ints){{-1, -1, -1, -1, 0, 0, 0, 0}});
        far = order(far, __builtin_shufflevector(far, far, 0, 1, 4, 5, 2, 3, 6, 7), (ints){{-1, -1, -1, -1, 0, 0, 0, 0}});
        far = order(far, __builtin_shufflevector(far, far, 0, 2, 1, 4, 3, 6, 5, 7), (ints){{-1, -1, 0, -1, 0, -1, 0, 0}});
        *(ints_anywhere*)(keys + top) = far;
        *(ints_anywhere*)(parents + top) = (ints)parent;
        top += __builtin_popcount(bits) - 1;
    }}
#endif
""")
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
    """From node `at` on, or NO_CHILD, to the next leaf whose box is entered no farther than the limit, nearest first."""


@wp.func_native("return (int)(found >> 32);")
def top_of(found: wp.uint64) -> int:  # type: ignore[empty-body]
    """How many entries the stack has."""


@wp.func_native("return (int)(unsigned)found;")
def leaf_of(found: wp.uint64) -> int:  # type: ignore[empty-body]
    """The leaf, as a node has it, or NO_CHILD."""
