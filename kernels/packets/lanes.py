"""Access to single lanes, where Warp would copy all sixteen, and reductions over sixteen lanes."""

import warp as wp

from .packet import PacketHits, Vectors, int_lanes, lanes


@wp.func_native("""
    auto& all = *wp::address(vectors, 0);
    return wp::vec3(all.x[i], all.y[i], all.z[i]);
""")
def vector_of_lane(vectors: wp.array[Vectors], i: int) -> wp.vec3:
    """Vector i of sixteen."""


@wp.func_native("return wp::address(best, slot)->near[i];")
def near_of(best: wp.array[PacketHits], slot: int, i: int) -> float:  # type: ignore[empty-body]
    """Nearest possible distance [m] of the best hit of lane i."""


@wp.func_native("return wp::address(best, slot)->far[i];")
def far_of(best: wp.array[PacketHits], slot: int, i: int) -> float:  # type: ignore[empty-body]
    """Farthest possible distance [m] of the best hit of lane i."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    int bits = 0;
    for (int i = 0; i < 16; ++i) bits |= (a[i] < 0) << i;
    return bits;
#else
    typedef int ints __attribute__((ext_vector_type(8)));
    typedef bool bools __attribute__((ext_vector_type(8)));
    ints values[2];
    __builtin_memcpy(&values, &a, sizeof(values));
    bools negative[2] = {
        __builtin_convertvector(values[0] < 0, bools),
        __builtin_convertvector(values[1] < 0, bools),
    };
    unsigned char low, high;
    __builtin_memcpy(&low, &negative[0], sizeof(low));
    __builtin_memcpy(&high, &negative[1], sizeof(high));
    return low | high << 8;
#endif
""")
def lane_bits(a: int_lanes) -> int:  # type: ignore[empty-body]
    """Bit mask of the numbers below 0, in two instructions that LLVM does not make of a loop."""


def _reduced(name: str) -> str:
    """C++ for the min or max of sixteen floats, none below 0, compared as integers, which have the same order."""
    return f"""
#if defined(__CUDA_ARCH__)
    float reduced = a[0];
    for (int i = 1; i < 16; ++i) reduced = wp::{name}(reduced, a[i]);
    return reduced;
#else
    typedef int ints __attribute__((ext_vector_type(16)));
    ints values;
    __builtin_memcpy(&values, &a, sizeof(values));
    int bits = __builtin_reduce_{name}(values);
    float reduced;
    __builtin_memcpy(&reduced, &bits, sizeof(reduced));
    return reduced;
#endif
"""


@wp.func_native(_reduced("min"))
def least_of(a: lanes) -> float:  # type: ignore[empty-body]
    """The least of sixteen numbers, none of which is below 0."""


@wp.func_native(_reduced("max"))
def most_of(a: lanes) -> float:  # type: ignore[empty-body]
    """The largest of sixteen numbers, none of which is below 0."""
