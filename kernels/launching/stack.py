"""The stack of a kernel on the CPU."""

import warp as wp

CACHE_LINE = 64
"""Bytes."""


# without a return type, which Warp 1.12 would take for that of a value
@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    alignas({CACHE_LINE}) volatile char line[{CACHE_LINE}];
    line[0] = 0;
#endif
""")
def align_stack():  # type: ignore[no-untyped-def]
    """Let what a kernel keeps on the stack begin on a cache line.

    Warp's vectors are aligned as their numbers are: in every second process half of them would lie across two lines.
    """
