"""Traversal of a BVH by a single ray on CUDA, from one leaf to the next."""

import warp as wp

from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.trees.nodes import Node
from rigcast.kernels.trees.tree import STACK

ENTRIES = wp.constant(2 * STACK)
"""Entries of a stack for both levels."""


@wp.func_native(on_cuda("return reinterpret_cast<wp::uint64>(nodes.data);"))
def address_of_nodes(nodes: wp.array[Node]) -> wp.uint64:
    """Address of the first node. An address is cheaper to pass and to select than an array."""


@wp.func_native(on_cuda("return reinterpret_cast<wp::uint64>(visible.data + first);"))
def address_of_visible(visible: wp.array[wp.bool], first: int) -> wp.uint64:
    """Address of entry `first`."""


@wp.func_native(on_cuda("return reinterpret_cast<wp::uint64>(stack.data);"))
def address_of_stack(stack: wp.array[wp.uint64]) -> wp.uint64:
    """Address of the stack's first entry."""


# A node is read as 14 float4, two per field, the ends that the ray reaches first before the others. Indices are
# unsigned, because these become addresses in one instruction. The ray reaches an end e at e i - o i with i = 1 / d, by
# fused multiply-adds. With errors of 4u in i and of u each in o, d, o i and two sums, that is off by less than
# 10u (|e| + |o|) |i|; box_margin is 8u (|e| + |o|), hence the factor 1.25.
#
# Non-negative floats compare in the same order as their bits do as integers, and negative ones as less than 0. The key
# of an entered child is its distance with the last three bits replaced by the child's number; that of any other child
# has its first bit set. The limit has the last three bits set, so that no key at the same distance is beyond it; -0
# becomes 0.
@wp.func_native(
    on_cuda("""
    const auto* tree = reinterpret_cast<const float4*>(nodes);
    auto* entries = reinterpret_cast<wp::uint64*>(stack);
    const int no_child = (int)0x80000000;
    const unsigned none = ~0u;
    const int last = ::max(__float_as_int(limit), 0) | 7;
    const float ix = inverse[0], iy = inverse[1], iz = inverse[2];
    const float ox = -origin[0] * ix, oy = -origin[1] * iy, oz = -origin[2] * iz;
    const float wider = 1.25f * margin, mx = wider * ::fabsf(ix), my = wider * ::fabsf(iy), mz = wider * ::fabsf(iz);
    const unsigned back_x = ix < 0.0f ? 6 : 0, back_y = iy < 0.0f ? 6 : 0, back_z = iz < 0.0f ? 6 : 0;
    const unsigned row[6] = {back_x, 2 + back_y, 4 + back_z, 6 - back_x, 8 - back_y, 10 - back_z};
    const auto* is_visible = reinterpret_cast<const bool*>(visible);
    auto unless_hidden = [&](int child) { return child < 0 && is_visible && !is_visible[~child] ? no_child : child; };
    while (true) {
        while (at == no_child && top > bottom) {
            const wp::uint64 entry = entries[--top];
            if ((int)(unsigned)(entry >> 32) <= last) at = unless_hidden((int)(unsigned)entry);
        }
        if (at < 0) return wp::uint64(top) << 32 | unsigned(at);
        const float4* node = tree + 14 * at;
        const int* child = reinterpret_cast<const int*>(node + 12);
        unsigned key[8] = {};
        unsigned missed = 0;
#pragma unroll 1
        for (int half = 0; half < 2; ++half) {
            float number[6][4];
#pragma unroll
            for (int i = 0; i < 6; ++i) {
                const float4 four = __ldg(tree + (14u * at + half + row[i]));
                number[i][0] = four.x, number[i][1] = four.y, number[i][2] = four.z, number[i][3] = four.w;
            }
#pragma unroll
            for (int j = 0; j < 4; ++j) {
                const int enter_x = __float_as_int(::fmaf(number[0][j], ix, ox - mx));
                const int enter_y = __float_as_int(::fmaf(number[1][j], iy, oy - my));
                const int enter_z = __float_as_int(::fmaf(number[2][j], iz, oz - mz));
                const int leave_x = __float_as_int(::fmaf(number[3][j], ix, ox + mx));
                const int leave_y = __float_as_int(::fmaf(number[4][j], iy, oy + my));
                const int leave_z = __float_as_int(::fmaf(number[5][j], iz, oz + mz));
                const int enter = ::max(::max(::max(enter_x, enter_y), enter_z), 0);
                const bool is_entered = enter <= ::min(::min(::min(leave_x, leave_y), leave_z), last);
                key[j] = key[4 + j];
                key[4 + j] = is_entered ? (enter & ~7) | (4 * half + j) : none;
                missed += key[4 + j] >> 31;
            }
        }
        const int count = 8 - missed;
        at = no_child;
        if (count == 0) continue;
        // a network that sorts eight
        auto order = [&](int a, int b) {
            const unsigned low = ::min(key[a], key[b]);
            key[b] = ::max(key[a], key[b]);
            key[a] = low;
        };
        if (count > 1) {
            order(0, 2), order(1, 3), order(4, 6), order(5, 7), order(0, 4), order(1, 5), order(2, 6), order(3, 7);
            order(0, 1), order(2, 3), order(4, 5), order(6, 7), order(2, 4), order(3, 5), order(1, 4), order(3, 6);
            order(1, 2), order(3, 4), order(5, 6);
            top += count - 1;
#pragma unroll 1
            for (int to = top - 1; key[1] != none; --to) {
                entries[to] = wp::uint64(key[1]) << 32 | unsigned(__ldg(child + (key[1] & 7)));
#pragma unroll
                for (int j = 1; j < 7; ++j) key[j] = key[j + 1];
                key[7] = none;
            }
        } else {
#pragma unroll
            for (int j = 1; j < 8; ++j) key[0] = ::min(key[0], key[j]);
        }
        at = unless_hidden(__ldg(child + (key[0] & 7)));
    }
""")
)
def next_leaf(
    nodes: wp.uint64,
    visible: wp.uint64,
    at: int,
    origin: wp.vec3,
    inverse: wp.vec3,
    margin: float,
    limit: float,
    stack: wp.uint64,
    top: int,
    bottom: int,
) -> wp.uint64:
    """Go on to the next leaf whose box the ray enters no farther than the limit; children are taken nearest first.

    Args:
        nodes, stack: their addresses.
        visible: address of a bool per leaf, whether it is visited; 0 to visit all.
        at: node to go on from; NO_CHILD to pop one from the stack.
        inverse, margin: of the ray, see rigcast.kernels.single.ray.
        limit: distance [m], at least 0.
        top: height of the stack.
        bottom: height down to which entries may be popped.

    Returns:
        The leaf as ~leaf, or NO_CHILD if there is none, in the lower 32 bits; the new height in the upper 32 bits.
    """
