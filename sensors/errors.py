"""The error that rigcast raises for invalid input, and its warnings."""

import sys
import warnings
from operator import index
from types import NoneType


class InputError(ValueError):
    """Invalid input from the user: a rig, a model, an array, a folder.

    The message has one line per fault: what is wrong, where, what was got and what was expected.
    """


def require_type(what: str, value: object, *kinds: type) -> None:
    """Raise InputError if `value` is of none of these types. what: its name in the message."""
    if not isinstance(value, kinds):
        expected = " or ".join("None" if kind is NoneType else kind.__name__ for kind in kinds)
        raise InputError(f"{what}: got {type(value).__name__}, expected {expected}")


def require_whole(what: str, value: object, least: int) -> None:
    """Raise InputError unless `value` is a whole number, at least `least`. what: its name in the message."""
    try:
        number = least - 1 if isinstance(value, bool) else index(value)  # type: ignore[arg-type]
    except TypeError:
        number = least - 1
    if number < least:
        raise InputError(f"{what}: got {value!r:.80}, expected a whole number from {least} on")


def warn_user(message: str, category: type[Warning]) -> None:
    """Warn at the line outside of rigcast from which it was called."""
    level, frame = 1, sys._getframe()
    # a fixed stacklevel would depend on Python: from 3.12 on comprehensions have no frame
    while frame.f_back is not None and frame.f_globals["__name__"].startswith("rigcast."):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
