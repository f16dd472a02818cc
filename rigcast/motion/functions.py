"""Users' functions, by their names `module:function`."""

import inspect
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rigcast.sensors.errors import InputError


class FunctionFault(InputError):
    """A user's function raised, or returned something unusable."""


@dataclass(frozen=True)
class UserFunction:
    """A user's function. name: `module:function`. folder: file names in messages are relative to it."""

    name: str
    folder: Path
    function: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        """Call the function. Raises FunctionFault, with the line, in place of whatever it raises."""
        try:
            return self.function(*arguments)
        except (Exception, SystemExit) as error:
            place = self._raised_at(error) or self._defined_at()
            raise FunctionFault(f"{place}{self.name}: {type(error).__name__}: {error}") from error

    def wrong(self, message: str) -> FunctionFault:
        """A FunctionFault for an unusable return value."""
        return FunctionFault(f"{self._defined_at()}{self.name}: {message}")

    def returned(self, function: Callable[..., Any]) -> "UserFunction":
        """Wrap a function that this one has returned."""
        return UserFunction(self.name, self.folder, function)

    def _raised_at(self, error: BaseException) -> str:
        """The last line of the function's module in the traceback; empty if none, as with wrong arguments."""
        own = module_file(self.name)
        lines = [
            line for frame, line in traceback.walk_tb(error.__traceback__) if Path(frame.f_code.co_filename) == own
        ]
        return "" if own is None or not lines else self._place(own, lines[-1])

    def _defined_at(self) -> str:
        """The place of the function's definition; empty for functions not written in Python."""
        try:
            function = inspect.unwrap(self.function)
            file, (_, line) = inspect.getsourcefile(function), inspect.getsourcelines(function)
        except (TypeError, OSError):
            return ""
        return "" if file is None else self._place(Path(file), line)

    def _place(self, file: Path, line: int) -> str:
        inside = file.resolve().is_relative_to(self.folder)
        return f"{file.resolve().relative_to(self.folder) if inside else file}:{line}: "


def find_function(folder: Path, name: str) -> UserFunction:
    """The `module:function` of this name; the module may be in this folder. Raises InputError if there is none."""
    module, _, attribute = name.partition(":")
    place = str(folder.resolve())
    if place not in sys.path:
        sys.path.insert(0, place)
    try:
        function = getattr(import_module(module), attribute)
    except (Exception, SystemExit) as error:  # importing the user's module may raise anything
        raise InputError(f"{name} cannot be imported: {type(error).__name__}: {error}") from None
    if not callable(function):
        raise InputError(f"{name}: got {type(function).__name__}, expected a function")
    return UserFunction(name, folder.resolve(), function)


def module_file(name: str) -> Path | None:
    """The file of the module of `module:function`; None if it has none."""
    spec = find_spec(name.partition(":")[0])
    return None if spec is None or spec.origin is None else Path(spec.origin)
