"""Memory that has been freed, but that the C library keeps for itself."""

import ctypes
import sys


def give_back_freed_memory() -> None:
    """Give it back to the system, where the C library can: glibc. Else it waits for the next large arrays."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
