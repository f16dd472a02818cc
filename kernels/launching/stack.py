"""Alignment of a kernel's stack frame on the CPU."""

import warp as wp

CACHE_LINE = 64
"""Size of a cache line [bytes]."""


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    alignas({CACHE_LINE}) volatile char line[{CACHE_LINE}];
    line[0] = 0;
#endif
""")
def align_stack():  # type: ignore[no-untyped-def]
    """Align the calling kernel's stack frame to a cache line.

    Warp aligns a vector like its scalars. Without this, in every second process half of the vectors would straddle two
    lines.
    """
