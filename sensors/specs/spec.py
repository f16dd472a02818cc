"""The base of everything a user specifies.

A specification is a frozen record with keyword arguments only. The keys of a YAML rig are these arguments,
checked by the same rules: unknown keys, text in place of numbers, and NaN are refused.
"""

from collections.abc import Mapping, Sequence
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, NoReturn, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo, model_validator

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import faults_of, refuse
from rigcast.sensors.names import listing

if TYPE_CHECKING:  # type checkers know constructors' arguments through pydantic's own metaclass
    _Record = BaseModel
else:

    class _RefusesInput(type(BaseModel)):
        """Makes a constructor called from Python raise InputError.

        Only `Lidar(...)` comes by here. pydantic builds the specs nested in a document itself, so that a
        fault in one of those keeps its place within the whole document.
        """

        def __call__(cls, *unnamed: Any, **given: Any) -> Any:
            if unnamed:
                required_first = sorted(cls.model_fields, key=lambda name: not cls.model_fields[name].is_required())
                names = listing([f"{name}=..." for name in required_first])
                raise InputError(f"{cls.__name__}: got {unnamed[0]!r:.80} without a name, expected some of {names}")
            try:
                return super().__call__(**given)
            except ValidationError as error:
                name = given.get("name")
                owner = f"{cls.__name__} {name!r}" if isinstance(name, str) else cls.__name__
                refuse(owner, faults_of(error, cls))

    class _Record(BaseModel, metaclass=_RefusesInput):
        pass


_Given = TypeVar("_Given", contravariant=True)
_Held = TypeVar("_Held", covariant=True)

if TYPE_CHECKING:

    class Takes(Generic[_Given, _Held]):
        """The type of a field that accepts the first of these types and holds the second."""

        def __get__(self, spec: object, owner: Any) -> _Held: ...
        def __set__(self, spec: Any, value: _Given) -> None: ...
else:

    class Takes:
        """To pydantic the type that is held, to which `_plain` and pydantic bring what is given."""

        def __class_getitem__(cls, types: tuple[Any, Any]) -> Any:
            return types[1]


Numbers = Sequence[float] | NDArray[np.floating[Any] | np.integer[Any]]
Integers = Sequence[int] | NDArray[np.integer[Any]]
Keys = dict[str, Any]
"""The arguments of a specification, given in its place."""
Share = Annotated[float, Field(ge=0, le=1)]


def optional(**options: Any) -> Any:
    """A pydantic `Field` with a default of the type that a field of type `Takes` holds."""
    return Field(**options)


class Spec(_Record):
    """A frozen, strict record. Raises InputError with one line per fault."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Append the arguments to the docstring, with the descriptions of their fields."""
        lines = [f"    {name}: {field.description}." for name, field in cls.model_fields.items() if field.description]
        cls.__doc__ = "\n".join([cleandoc(cls.__doc__ or ""), "", "Args:", *lines])

    if not TYPE_CHECKING:  # type checkers know that it is frozen

        def __setattr__(self, name: str, value: Any) -> None:
            self._refuse_change(f"{name} cannot be set")

        def __delattr__(self, name: str) -> None:
            self._refuse_change(f"{name} cannot be deleted")

        def _refuse_change(self, what: str) -> NoReturn:
            owner = type(self).__name__
            raise InputError(f"{owner}: {what}; {owner}.model_copy(update=...) gives another {owner}")

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:  # noqa: ARG002
        """A copy with the values of `update` in place of its own.

        Raises InputError for values that the constructor refuses, unlike pydantic's `model_copy`.
        """
        own = {key: getattr(self, key) for key in self.model_fields_set}
        return type(self)(**{**own, **(update or {})})

    @model_validator(mode="before")
    @classmethod
    def _as_plain_values(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        return {key: _plain(value) for key, value in given.items()}


def _plain(value: Any) -> Any:
    """NumPy values as Python values, and lists as tuples, as the fields hold them."""
    if isinstance(value, np.ndarray) and value.ndim == 2:  # perhaps of many rows
        return tuple(map(tuple, value.tolist()))
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return tuple(_plain(item) for item in value) if isinstance(value, list | tuple) else value


def _as_path(given: Any) -> Any:
    if not isinstance(given, str | Path):
        raise ValueError(f"must be the path of a file, got {given!r}")
    return Path(given)


FilePath = Annotated[Path, BeforeValidator(_as_path)]


def folder_of(key: str, info: ValidationInfo) -> Path | None:
    """The folder of the file in which this key of a sensor is written; None in Python."""
    return None if info.context is None else info.context[key]


def beside(folder: Path | None, path: Path) -> Path:
    """The path of a file that is named in a file in this folder; without a folder, in Python, the path as it is.

    Raises ValueError for a path outside of the folder, because rigs may come from untrusted sources.
    """
    if folder is None:
        return path
    if not is_inside(folder, path):
        raise ValueError(f"{str(path)!r} is outside of the rig file's folder, expected a file in it")
    return folder / path


def is_inside(folder: Path, file: Path) -> bool:
    """Whether a file is in a folder after all links are resolved."""
    try:
        return (folder / file).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # circular links, a zero byte
        return False
