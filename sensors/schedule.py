"""When readings fall due."""

import math

# A due time that the clock has reached up to rounding counts as reached; in periods.
_ROUNDING = 1e-6


class Schedule:
    """The due times of one sensor: every multiple of 1 / rate_hz on the simulation's clock, or every step.

    Each due time is given out once, whatever the timestep. The first call looks back one timestep; a clock that
    goes backwards (a reset) starts over.
    """

    def __init__(self, rate_hz: float | None, timestep: float) -> None:
        self._rate_hz = rate_hz
        self._timestep = timestep
        self._last_time = math.nan

    def due(self, time: float) -> list[float]:
        """The due times [s] since the last call, up to and including `time` [s]."""
        if not self._last_time <= time:
            self._last_time = time - self._timestep
        last_time, self._last_time = self._last_time, time
        if self._rate_hz is None:
            return [time] if time > last_time else []
        first, last = self._count(last_time) + 1, self._count(time)
        return [k / self._rate_hz for k in range(first, last + 1)]

    def _count(self, time: float) -> int:
        assert self._rate_hz is not None
        return math.floor(time * self._rate_hz + _ROUNDING)
