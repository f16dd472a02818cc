"""How CPU threads claim work: turns of fixed length by their number, or runs whose length depends on what is left."""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return atomicAdd(&turns.data[0], 1);
#else
    return __atomic_fetch_add(&turns.data[0], 1, __ATOMIC_RELAXED);
#endif
""")
def turn_of(turns: wp.array[int]) -> int:  # type: ignore[empty-body]
    """Claim the next turn and return its number. Native, because `wp.atomic_add` is not atomic on a CPU."""


LEAST = wp.constant(8)
"""Minimum length of a run, unless fewer items are left."""
PARTS = wp.constant(4)
"""A run is 1 / (PARTS threads) of the items left."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return atomicCAS(&taken.data[0], was, to);
#else
    return __sync_val_compare_and_swap(&taken.data[0], was, to);
#endif
""")
def swap(taken: wp.array[int], was: int, to: int) -> int:  # type: ignore[empty-body]
    """Atomic compare-and-swap: set taken[0] to `to` if it equals `was`; return its old value."""


@wp.func
def end_of_run(begin: int, count: int, threads: int) -> int:
    """End of the run that begins at `begin`. Runs are long at first, because neighbours share a thread's cache, and
    short in the end, so that no thread waits long for the last one."""
    return wp.min(begin + wp.max(LEAST, (count - begin) / (PARTS * threads)), count)


@wp.func
def take_run(taken: wp.array[int], count: int, threads: int) -> int:
    """Claim a run of items 0..count-1 and return its begin; `count` if none are left. taken: (1,) items claimed."""
    begin = int(0)
    seen = swap(taken, begin, end_of_run(begin, count, threads))
    while seen != begin:
        begin = seen
        seen = swap(taken, begin, end_of_run(begin, count, threads))
    return begin
