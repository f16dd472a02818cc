"""Release of freed memory that the C library retains."""

import ctypes
import sys


def give_back_freed_memory() -> None:
    """Return freed memory to the system, if the C library can (glibc); else it stays for the next large arrays."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
