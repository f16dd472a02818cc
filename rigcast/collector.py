"""Python's collector of reference cycles, which walks what a start makes several times, though all of it stays."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_FEW = 1000
"""More than Python has frozen when it starts, which are 375 in 3.12, and fewer than there are for others to freeze."""


@contextmanager
def paused_collector() -> Iterator[None]:
    """No cycles are looked for meanwhile; what has been made then counts as old, and is looked at as seldom."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() < _FEW:  # else others' frozen objects would thaw
            gc.freeze()
            gc.unfreeze()  # into the oldest generation
        if was_enabled:
            gc.enable()
