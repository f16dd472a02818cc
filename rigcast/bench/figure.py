"""One measured quantity."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Spread:
    """The median of several measurements, with the lowest and the highest."""

    median: float
    lowest: float
    highest: float

    @staticmethod
    def of(values: npt.ArrayLike) -> "Spread":
        array = np.asarray(values)
        return Spread(float(np.median(array)), float(array.min()), float(array.max()))


@dataclass(frozen=True)
class Figure:
    """One thing measured, in a unit. key: a name for programs."""

    key: str
    what: str
    unit: str
    value: Spread
