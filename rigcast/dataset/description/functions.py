"""Functions of the user's own, by their names `module:function`."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rigcast.sensors.errors import InputError


def find_function(folder: Path, name: str) -> Callable[..., Any]:
    """The `module:function` of this name; the module may be in this folder. Raises InputError where there is none."""
    module, _, attribute = name.partition(":")
    _find_modules_in(folder)
    try:
        function = getattr(import_module(module), attribute)
    except Exception as error:  # whatever the user's module does when it is imported
        raise InputError(f"{name} cannot be imported: {type(error).__name__}: {error}") from None
    if not callable(function):
        raise InputError(f"{name}: got {type(function).__name__}, expected a function")
    return function


def _find_modules_in(folder: Path) -> None:
    place = str(folder.resolve())
    if place not in sys.path:
        sys.path.insert(0, place)


def module_file(name: str) -> Path | None:
    """The file of the module of `module:function`; None of one that has none."""
    spec = find_spec(name.partition(":")[0])
    return None if spec is None or spec.origin is None else Path(spec.origin)


@contextmanager
def blaming(name: str) -> Iterator[None]:
    """Raise InputError in place of whatever a function of the user's raises, with its name."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{name}: {type(error).__name__}: {error}") from error
