"""The number of CPU threads."""

import os
import re

from rigcast.sensors.errors import InputError

_VARIABLE = "RIGCAST_THREADS"


def set_threads(count: int | None) -> None:
    """Set the number of CPU threads for building trees and casting, in this process and those that it starts.

    None: as many as the process may use, which is the default unless RIGCAST_THREADS is set. Neither trees nor frames
    depend on it, bit for bit.

    Raises:
        InputError: not a whole number from 1 to 9999.
    """
    if count is None:
        os.environ.pop(_VARIABLE, None)
        return
    _require_count("set_threads: count", count)
    os.environ[_VARIABLE] = str(count)


def require_thread_count() -> None:
    """Raise InputError if RIGCAST_THREADS is set to anything but a whole number from 1 to 9999."""
    wanted = os.environ.get(_VARIABLE)
    if wanted:
        _require_count(_VARIABLE, wanted)


def _require_count(what: str, given: object) -> None:
    if isinstance(given, bool) or not re.fullmatch("[1-9][0-9]{0,3}", str(given)):
        raise InputError(f"{what}: got {given!r}, expected a whole number from 1 to 9999")
