"""Pausing of Python's garbage collector, which scans the objects made at start-up several times although all stay."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_FEW = 1000
"""More objects than Python freezes at its own start (375 in 3.12), and fewer than others would freeze."""


@contextmanager
def paused_collector() -> Iterator[None]:
    """Pause the collector; objects made meanwhile then count as old, and are scanned as seldom."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() < _FEW:  # else objects frozen by others would be unfrozen
            gc.freeze()
            gc.unfreeze()  # moves objects into the oldest generation
        if was_enabled:
            gc.enable()
