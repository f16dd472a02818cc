"""When readings fall due."""

import math

from rigcast.sensors.errors import InputError

# A due time that the clock has reached up to rounding counts as reached; in periods.
_ROUNDING = 1e-6
_MOST = 100_000  # readings of one sensor in one step; more are a clock gone wrong


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
        """The due times [s] since the last call, up to and including `time` [s].

        Raises InputError for a clock that is not finite or leaps over 100 000 readings; the next call is a first one.
        """
        if not math.isfinite(time):
            self._last_time = math.nan
            raise InputError(f"clock: got {time} s, expected a finite time")
        if not self._last_time <= time:
            self._last_time = time - self._timestep
        last_time, self._last_time = self._last_time, time
        if self._rate_hz is None:
            return [time] if time > last_time else []
        first, last = self._count(last_time) + 1, self._count(time)
        if last - first >= _MOST:
            self._last_time = math.nan
            raise InputError(
                f"clock: got {time:g} s after {last_time:g} s, {last - first + 1} readings at {self._rate_hz:g} Hz, "
                f"expected steps with fewer than {_MOST}"
            )
        return [k / self._rate_hz for k in range(first, last + 1)]

    def _count(self, time: float) -> int:
        assert self._rate_hz is not None
        return math.floor(time * self._rate_hz + _ROUNDING)
