"""Turns that threads of the CPU take at what is to be done."""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return atomicAdd(&turns.data[0], 1);
#else
    return __atomic_fetch_add(&turns.data[0], 1, __ATOMIC_RELAXED);
#endif
""")
def turn_of(turns: wp.array[int]) -> int:  # type: ignore[empty-body]
    """The number of a turn that no other thread has: atomically, which `wp.atomic_add` is not on a CPU."""
