"""A filter or a mount per world."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.faults import refuse
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.mount import Mount

Value = TypeVar("Value", Filter, Mount)


@dataclass(frozen=True)
class PerWorld(Generic[Value]):
    """One value per world: the distinct values, and the index of each world's."""

    values: tuple[Value, ...]
    of_world: tuple[int, ...]

    @staticmethod
    def of(what: str, given: object, kind: type[Value], worlds: int) -> "PerWorld[Value]":
        """From a list of one value per world; raises InputError for anything else. what: its name in messages."""
        if isinstance(given, str | kind) or not isinstance(given, Sequence):
            raise InputError(f"{what}: got {type(given).__name__}, expected a list of {kind.__name__}, one per world")
        if len(given) != worlds:
            raise InputError(f"{what}: got {len(given)}, expected {worlds}: one per world")
        for world, value in enumerate(given):
            require_type(f"{what}: world {world}", value, kind)
        place = {value: k for k, value in enumerate(dict.fromkeys(given))}
        return PerWorld(tuple(place), tuple(place[value] for value in given))

    def check(self, what: str, model: mujoco.MjModel) -> None:
        """Raise InputError if one of the values names something that the model does not have."""
        for k, value in enumerate(self.values):
            if faults := value.faults(model):
                refuse(f"{what}: world {self.of_world.index(k)}", faults)

    def each(self, compute: Callable[[Value], NDArray[Any]]) -> NDArray[Any]:
        """An array (nworld, ...) of a function's result for each world's value."""
        return np.array([compute(value) for value in self.values])[list(self.of_world)]
