"""Rays in the order in which they are fired, spread over the readings of a lidar."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.specs.pattern import Pattern


@dataclass(frozen=True, eq=False)
class RayTable:
    """Rows of a measurement each: directions (n, 3), unit, and ring (n,).

    times: (n,) [s] from the first row on, ascending; None: all at once. origins: (n, 3) [m]; None: the frame's origin.
    """

    directions: NDArray[np.float64]
    ring: NDArray[np.int32]
    times: NDArray[np.float64] | None
    origins: NDArray[np.float64] | None = None

    @property
    def length(self) -> float:
        """Duration of the rows [s], including a time after the last row equal to the mean time between rows."""
        rows = len(self.ring)
        return 0.0 if self.times is None else float(self.times[-1]) * rows / max(rows - 1, 1)

    def readings(self, rate_hz: float | None) -> int:
        """Over how many readings the rows are spread; they start again after the last of them."""
        return 1 if rate_hz is None else max(1, int(np.ceil(self.length * rate_hz - 1e-6)))

    def pattern(self, rate_hz: float | None, phase: float) -> Pattern:
        """Rays (rays,), all readings of one size; column counts the rows of a reading.

        Needs a row per reading, and one reading if there are origins.
        """
        readings = self.readings(rate_hz)
        rays = len(self.ring) // readings
        column = np.arange(rays, dtype=np.int32)

        def at(time: float, _: bool = False) -> Pattern:
            reading = 0 if rate_hz is None else round((time - phase) * rate_hz) % readings
            rows = slice(reading * rays, (reading + 1) * rays)
            fired = None if self.times is None else self.times[rows] - self.times[rows][0]
            return Pattern(self.directions[rows], self.origins, fired, self.ring[rows], column, later=later)

        later = at if readings > 1 else None
        return at(phase)
