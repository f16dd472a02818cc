"""Patterns from a user's arrays: one measurement per row, with its direction and, if any, its time, ring and origin."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator

from rigcast.sensors.specs.pattern import MOST_RAYS, Pattern
from rigcast.sensors.specs.spec import Integers, Numbers, Spec, Takes, optional

from .ray_table import RayTable

_Vector = tuple[float, float, float]
_Vectors = Sequence[Numbers] | NDArray[np.floating | np.integer]


class RayArrays(Spec):
    """Rays from arrays, or lists, with a row per measurement.

    Rays that take longer than 1 / rate_hz are spread evenly over successive readings and start again after the last of
    them. Rows left over, fewer than there are readings, are not used.
    """

    # Of each only the first fault is told: an array may have millions.
    directions: Takes[_Vectors, tuple[_Vector, ...]] = Field(
        fail_fast=True, repr=False, description="(n, 3), x forward, y left, z up, of any length but 0"
    )
    times: Takes[Numbers | None, tuple[float, ...] | None] = optional(
        default=None,
        fail_fast=True,
        repr=False,
        description="(n,) when each ray is fired [s], ascending; the first one fires at the time of the reading; null: "
        "all at once",
    )
    rings: Takes[Integers | None, tuple[Annotated[int, Field(ge=0, lt=2**31)], ...] | None] = optional(
        default=None, fail_fast=True, repr=False, description="(n,) ring of each ray; null: 0"
    )
    origins: Takes[_Vectors | None, tuple[_Vector, ...] | None] = optional(
        default=None,
        fail_fast=True,
        repr=False,
        description="(n, 3) where each ray starts in the sensor's frame [m], of rays that are all of one reading; "
        "null: at 0, 0, 0",
    )

    @field_validator("directions")
    @classmethod
    def _some_and_not_zero(cls, directions: tuple[_Vector, ...]) -> tuple[_Vector, ...]:
        if not 1 <= len(directions) <= MOST_RAYS:
            raise ValueError(f"must have 1 to {MOST_RAYS} rows, got {len(directions)}")
        is_zero = ~np.array(directions, np.float64).any(axis=1)
        if is_zero.any():
            raise ValueError(f"must be of any length but 0, got [0, 0, 0] in row {is_zero.argmax()}")
        return directions

    @field_validator("times", "rings", "origins")
    @classmethod
    def _one_row_per_ray(cls, rows: tuple[object, ...] | None, info: ValidationInfo) -> tuple[object, ...] | None:
        rays = len(info.data.get("directions", ()))
        if rows is not None and rays and len(rows) != rays:
            raise ValueError(f"must have one row per row of directions, {rays}, got {len(rows)}")
        return rows

    @field_validator("times")
    @classmethod
    def _ascending(cls, times: tuple[float, ...] | None) -> tuple[float, ...] | None:
        goes_back = np.diff(times or ()) < 0
        if goes_back.any():
            raise ValueError(
                f"must be ascending, got a time before that of the row above in row {goes_back.argmax() + 1}"
            )
        return times

    def misfit(self, rate_hz: float | None) -> str | None:
        """Why the rays cannot be spread over readings at this rate; None if they can."""
        table = self._table()
        rays, readings = len(self.directions), table.readings(rate_hz)
        if readings > rays:
            return f"{rays} rows over {table.length:g} s are less than one per reading at {rate_hz:g} Hz; expected more"
        if readings > 1 and self.origins is not None:
            return f"{table.length:g} s are {readings} readings at {rate_hz:g} Hz; with origins they must be one"
        return None

    def pattern(self, rate_hz: float | None, phase: float) -> Pattern:
        """Rays (rays,), all readings of one size; column counts the rows of a reading."""
        return self._table().pattern(rate_hz, phase)

    def _table(self) -> RayTable:
        directions = np.array(self.directions, np.float64)
        directions /= np.abs(directions).max(axis=1, keepdims=True)  # so that no square is 0 or inf
        return RayTable(
            directions / np.linalg.norm(directions, axis=1, keepdims=True),
            np.array(self.rings or np.zeros(len(directions)), np.int32),
            None if self.times is None else np.subtract(self.times, self.times[0]),
            None if self.origins is None else np.array(self.origins, np.float64),
        )
