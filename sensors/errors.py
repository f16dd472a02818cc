"""The one error that rigcast raises for what a user gives it, and how it warns."""

import sys
import warnings
from operator import index
from types import NoneType


class InputError(ValueError):
    """Something given by the user cannot be used: a rig, a model, an array, a folder.

    The message says what is wrong, where, what was got and what was expected, one line per fault.
    """


def require_type(what: str, value: object, *kinds: type) -> None:
    """Raise InputError where `value`, which a message calls `what`, is of none of these types."""
    if not isinstance(value, kinds):
        expected = " or ".join("None" if kind is NoneType else kind.__name__ for kind in kinds)
        raise InputError(f"{what}: got {type(value).__name__}, expected {expected}")


def require_whole(what: str, value: object, least: int) -> None:
    """Raise InputError where `value`, which a message calls `what`, is no whole number from `least` on."""
    try:
        number = least - 1 if isinstance(value, bool) else index(value)  # type: ignore[arg-type]
    except TypeError:
        number = least - 1
    if number < least:
        raise InputError(f"{what}: got {value!r:.80}, expected a whole number from {least} on")


def warn_user(message: str, category: type[Warning]) -> None:
    """Warn at the line outside of rigcast that led here."""
    level, frame = 1, sys._getframe()
    # a fixed stacklevel would depend on Python: from 3.12 on comprehensions have no frame
    while frame.f_back is not None and frame.f_globals["__name__"].startswith("rigcast."):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
