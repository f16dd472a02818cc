"""Traversal of a BVH by a single ray on CUDA, from one leaf to the next."""

import warp as wp

from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.trees.nodes import Four
from rigcast.kernels.trees.tree import STACK

ENTRIES = 2 * STACK
"""Entries of a stack for both levels."""
FEWEST = 16
"""Rays of a warp that must enter a box on average for all to go to it."""


@wp.func_native(on_cuda("return reinterpret_cast<wp::uint64>(nodes.data);"))
def address_of_nodes(nodes: wp.array[Four]) -> wp.uint64:
    """Address of the first node. An address is cheaper to pass and to select than an array."""


@wp.func_native(on_cuda("return reinterpret_cast<wp::uint64>(visible.data + first);"))
def address_of_visible(visible: wp.array[wp.bool], first: int) -> wp.uint64:
    """Address of entry `first`."""


# Volatile, so that there is one stack per call. Its address leaves the scope in which PTX declares it, which is safe as
# nothing else in the kernel is declared in a scope.
@wp.func_native(
    on_cuda(f"""
    wp::uint64 address;
    asm volatile("{{ .local .align 8 .b8 entries[{8 * ENTRIES}]; .reg .u64 first; mov.u64 first, entries;"
                 " cvta.local.u64 %0, first; }}" : "=l"(address));
    return address;
""")
)
def address_of_stack() -> wp.uint64:
    """Address of a stack of ENTRIES in the thread's local memory. What they contain is undefined: setting a Warp array
    to 0 in every thread would take a third of the time of small casts."""


# A node is read as 6 float4 and an int4, see Four, the ends that the ray reaches first before the others. Indices are
# unsigned, because these become addresses in one instruction. The ray reaches an end e at e i - o i with i = 1 / d, by
# fused multiply-adds. With errors of 4u in i and of u each in o, d, o i and two sums, that is off by less than
# 10u (|e| + |o|) |i|; box_margin is 8u (|e| + |o|), hence the factor 1.25.
#
# Non-negative floats compare in the same order as their bits do as integers, and negative ones as less than 0. The key
# of an entered child is its distance with the last two bits replaced by the child's number; that of any other child
# has its first bit set. The limit has the last two bits set, so that no key at the same distance is beyond it; -0
# becomes 0.
@wp.func_native(
    on_cuda(
        f"constexpr int fewest = {FEWEST};"
        + """
    const auto* tree = reinterpret_cast<const float4*>(nodes);
    auto* entries = reinterpret_cast<wp::uint64*>(stack);
    const int no_child = (int)0x80000000;
    const unsigned none = ~0u;
    const int last = limit < 0.0f ? -1 : __float_as_int(::fabsf(limit)) | 3;
    const float ix = inverse[0], iy = inverse[1], iz = inverse[2];
    const float ox = -origin[0] * ix, oy = -origin[1] * iy, oz = -origin[2] * iz;
    const float wider = 1.25f * margin, mx = wider * ::fabsf(ix), my = wider * ::fabsf(iy), mz = wider * ::fabsf(iz);
    const unsigned back_x = ix < 0.0f ? 3 : 0, back_y = iy < 0.0f ? 3 : 0, back_z = iz < 0.0f ? 3 : 0;
    unsigned row[6] = {back_x, 1 + back_y, 2 + back_z, 3 - back_x, 4 - back_y, 5 - back_z};
    // else the compiler computes them anew at every node
#pragma unroll
    for (int i = 0; i < 6; ++i) asm("" : "+r"(row[i]));
    const auto* is_visible = reinterpret_cast<const bool*>(visible);
    auto unless_hidden = [&](int child) { return child < 0 && is_visible && !is_visible[~child] ? no_child : child; };
    auto in_any = [&](bool is_so) { return credit < 0 ? is_so : __any_sync(~0u, is_so); };
    auto least_of_all = [](unsigned number) {
#if __CUDA_ARCH__ >= 800
        return __reduce_min_sync(~0u, number);
#else
        for (int i = warpSize / 2; i > 0; i /= 2) number = ::min(number, __shfl_xor_sync(~0u, number, i));
        return number;
#endif
    };
    while (true) {
        while (at == no_child && top > bottom) {
            const wp::uint64 entry = entries[--top];
            if (in_any((int)(unsigned)(entry >> 32) <= last)) at = unless_hidden((int)(unsigned)entry);
        }
        if (at < 0) return {at, top, credit};
        // read with the boxes, as a read of one of them later would be waited for
        const int4 child = __ldg(reinterpret_cast<const int4*>(tree + (7u * at + 6)));
        auto child_of = [&](unsigned key) {
            const int low = key & 1 ? child.y : child.x, high = key & 1 ? child.w : child.z;
            return key & 2 ? high : low;
        };
        unsigned key[4];
        float number[6][4];
#pragma unroll
        for (int i = 0; i < 6; ++i) {
            const float4 four = __ldg(tree + (7u * at + row[i]));
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
            key[j] = is_entered ? (enter & ~3) | j : none;
        }
        if (credit >= 0) {
            unsigned nearest[4];
            int change = 0;
#pragma unroll
            for (int j = 0; j < 4; ++j) {
                nearest[j] = least_of_all(key[j]);
                change += __popc(__ballot_sync(~0u, key[j] != none)) - (nearest[j] == none ? 0 : fewest);
            }
            credit += change;
            if (credit >= 0) {
#pragma unroll
                for (int j = 0; j < 4; ++j) key[j] = nearest[j];
            }
        }
        auto order = [&](int a, int b) {
            const unsigned low = ::min(key[a], key[b]);
            key[b] = ::max(key[a], key[b]);
            key[a] = low;
        };
        order(0, 2), order(1, 3), order(0, 1), order(2, 3), order(1, 2);
        at = no_child;
        if (key[0] == none) continue;
        // the farthest first
        if (key[1] != none) {
#pragma unroll
            for (int j = 3; j > 0; --j) {
                const wp::uint64 entry = wp::uint64(key[j]) << 32 | unsigned(child_of(key[j]));
                if (key[j] != none) entries[top++] = entry;
            }
        }
        at = unless_hidden(child_of(key[0]));
    }
"""
    )
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
    credit: int,
) -> wp.vec3i:
    """Go on to the next leaf whose box the ray enters no farther than the limit; children are taken nearest first.

    Args:
        nodes, stack: their addresses.
        visible: address of a bool per leaf, whether it is visited; 0 to visit all.
        at: node to go on from; NO_CHILD to pop one from the stack.
        inverse, margin: of the ray, see rigcast.kernels.single.ray.
        limit: distance [m]; no box is entered if it is negative.
        top: height of the stack.
        bottom: height down to which entries may be popped.
        credit: -1, or while it is at least 0, all threads of a warp go the same way, to whatever any of their rays
            enters. All of them call it, with the same `at`, `top`, `bottom`, `credit`, and what is visible. For each
            box that any ray enters it changes by the number of rays that do, less FEWEST.

    Returns:
        The leaf as ~leaf, or NO_CHILD if there is none; the new height; the new credit.
    """
