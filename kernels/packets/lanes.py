"""Single rays of a packet, read alone, where Warp would copy all sixteen; and sixteen conditions as bits."""

import warp as wp

from .packet import Packet, PacketHits, int_lanes


@wp.func_native("return wp::address(packets, at)->p[i];")
def p_of(packets: wp.array[Packet], at: int, i: int) -> float:  # type: ignore[empty-body]
    """Where ray i of a packet is in its tile."""


@wp.func_native("return wp::address(packets, at)->q[i];")
def q_of(packets: wp.array[Packet], at: int, i: int) -> float:  # type: ignore[empty-body]
    """Where ray i of a packet is in its tile."""


@wp.func_native("return wp::address(packets, at)->length[i];")
def length_of(packets: wp.array[Packet], at: int, i: int) -> float:  # type: ignore[empty-body]
    """The length of a + p u + q v for ray i of a packet."""


@wp.func_native("return wp::address(best, slot)->near[i];")
def near_of(best: wp.array[PacketHits], slot: int, i: int) -> float:  # type: ignore[empty-body]
    """From where on the best hit of ray i may be."""


@wp.func_native("return wp::address(best, slot)->far[i];")
def far_of(best: wp.array[PacketHits], slot: int, i: int) -> float:  # type: ignore[empty-body]
    """Up to where the best hit of ray i may be."""


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
    """Bit by bit, which of sixteen numbers are below 0: two instructions, which no loop is turned into."""
