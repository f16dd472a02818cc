"""What threads of the CPU take of what is to be done: turns by their number, or runs of what is left."""

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


LEAST = wp.constant(8)
"""Of a run, unless fewer are left."""
PARTS = wp.constant(4)
"""Of what is left for each thread, of which a run is one."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return atomicCAS(&taken.data[0], was, to);
#else
    return __sync_val_compare_and_swap(&taken.data[0], was, to);
#endif
""")
def swap(taken: wp.array[int], was: int, to: int) -> int:  # type: ignore[empty-body]
    """How many are taken; if that is what it was, there are so many from now on."""


@wp.func
def end_of_run(begin: int, count: int, threads: int) -> int:
    """Where a run ends that begins there: long at first, as neighbours share what is in a thread's cache, and short in
    the end, so that no thread waits long for the last one."""
    return wp.min(begin + wp.max(LEAST, (count - begin) / (PARTS * threads)), count)


@wp.func
def take_run(taken: wp.array[int], count: int, threads: int) -> int:
    """Where a run begins that no other of so many threads has, of 0 to count - 1; count when all are taken."""
    begin = int(0)
    seen = swap(taken, begin, end_of_run(begin, count, threads))
    while seen != begin:
        begin = seen
        seen = swap(taken, begin, end_of_run(begin, count, threads))
    return begin
