"""Schedules: the times at which readings are due."""

import hashlib
import math
from functools import lru_cache

import numpy as np

from rigcast.sensors.errors import InputError

# A due time counts as reached when the clock is no further short of it than this, in periods: times are rounded.
_ROUNDING = 1e-6
_MOST = 100_000  # most readings of one sensor in one step; more indicate a wrong clock
_JITTER, _LOSS = 0, 1  # numbers of a reading's random draws


class Schedule:
    """The due times of one sensor: phase + k / rate_hz for every k on the simulation's clock; or every step.

    Each due time is given out once, whatever the timestep. The first call looks back one timestep; a clock that
    goes backwards (a reset) starts over.

    Args:
        rate_hz: None is every step.
        timestep: of the simulation [s].
        phase: in [0, 1 / rate_hz) [s].
        jitter: each due time is up to this much early or late [s], below 0.5 / rate_hz; uniform.
        frame_loss: share of the due times that are left out, at random.
        key: of the random numbers: those of reading k are the same whenever it is asked for.
    """

    def __init__(
        self,
        rate_hz: float | None,
        timestep: float,
        *,
        phase: float = 0.0,
        jitter: float = 0.0,
        frame_loss: float = 0.0,
        key: tuple[int, str] = (0, ""),
    ) -> None:
        self._rate_hz = rate_hz
        self._timestep = timestep
        self._phase, self._jitter, self._frame_loss = phase, jitter, frame_loss
        self._key = key
        self._last_time = math.nan

    @property
    def rounding(self) -> float:
        """Tolerance [s]: a time counts as reached when the clock is at most this much short of it."""
        return _ROUNDING * (self._timestep if self._rate_hz is None else 1 / self._rate_hz)

    def due(self, time: float) -> list[float]:
        """The due times [s] since the last call, up to and including `time` [s].

        Raises InputError for a time that is not finite or leaps over 100 000 readings; the next call is a first one.
        """
        if not math.isfinite(time):
            self._last_time = math.nan
            raise InputError(f"data.time: got {time} s, expected a finite time")
        if not self._last_time <= time:
            self._last_time = time - self._timestep
        last_time, self._last_time = self._last_time, time
        if self._rate_hz is None:
            return [time] if time > last_time and not self._lost(round(time / self._timestep)) else []
        first, last = self._count(last_time) + 1, self._count(time)
        if last - first >= _MOST:
            self._last_time = math.nan
            raise InputError(
                f"data.time: got {time:g} s after {last_time:g} s, {last - first + 1} readings at "
                f"{self._rate_hz:g} Hz, expected steps with fewer than {_MOST}"
            )
        return [self._time(k) for k in range(first, last + 1) if not self._lost(k)]

    def after(self, time: float) -> float:
        """The first due time [s] that the clock has not reached at `time` [s], perhaps of a reading that is lost.

        For a schedule with a rate.
        """
        return self._time(self._count(time) + 1)

    def _count(self, time: float) -> int:
        """The last k whose due time the clock has reached at `time`."""
        assert self._rate_hz is not None
        k = math.floor((time - self._phase) * self._rate_hz + _ROUNDING)
        if self._jitter:  # by less than half a period, so that only the neighbours are in question
            k = next(k for k in (k + 1, k, k - 1) if self._time(k) <= time + self.rounding)
        return k

    def _time(self, k: int) -> float:
        assert self._rate_hz is not None
        time = self._phase + k / self._rate_hz
        if self._jitter:
            time += self._jitter * (2 * uniform(self._key, k, _JITTER) - 1)
        return time

    def _lost(self, k: int) -> bool:
        return self._frame_loss > 0 and uniform(self._key, k, _LOSS) < self._frame_loss


@lru_cache(maxsize=256)  # the next reading's is asked for at every step
def uniform(key: tuple[int, str], frame: int, draw: int) -> float:
    """A random number in [0, 1) that depends only on its arguments: seed and name (key), frame, draw.

    Philox 4x64-10 (Salmon et al., Parallel Random Numbers: As Easy as 1, 2, 3, SC 2011).
    """
    seed, name = key
    hashed = int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little")
    counter = np.array([0, frame % 2**64, draw, 0], dtype=np.uint64)
    philox = np.random.Philox(key=np.array([seed, hashed], dtype=np.uint64), counter=counter)
    return float(int(philox.random_raw()) >> 11) * 2.0**-53
