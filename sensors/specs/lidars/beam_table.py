"""Tables of beams: rows of beams that are measured column after column, with or without a turning head."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.specs.pattern import Pattern, directions_at


@dataclass(frozen=True)
class BeamTable:
    """The parameters of `Lidar` for its beams, under the same names."""

    elevation_deg: Sequence[float]
    azimuth_offset_deg: Sequence[float] | None
    columns: int
    column_period_us: float | None
    azimuth_deg: tuple[float, float] | None
    clockwise: bool
    firing_time_us: Sequence[float] | None
    scan_time: float | None
    origin_radius: float
    origin_height: Sequence[float] | None
    rate_hz: float | None

    @property
    def column_count(self) -> int:
        """Number of columns in a turn or a sector."""
        if self.column_period_us is None or self.rate_hz is None:
            return self.columns
        return int(min(1e6 / (self.column_period_us * self.rate_hz) * (1 + 1e-12), 2.0**53))

    @property
    def duration(self) -> float:
        """Time from the first row of the first column to the last ray [s]."""
        return self._last_column_time + max(self.firing_time_us or (0.0,)) * 1e-6

    def pattern(self) -> Pattern:
        """Unit directions (beams, columns, 3), x forward and z up, with ring and column of each."""
        times, sweep = self._column_times(), self._sweep()
        fired = 1e-6 * self._per_row(self.firing_time_us)
        fired -= fired.min()
        speed = (sweep[-1] - sweep[0]) / times[-1] if times[-1] > 0 else 0.0  # [rad/s] of the head
        turned = sweep + speed * fired
        azimuth = turned + np.deg2rad(self._per_row(self.azimuth_offset_deg))
        elevation = np.deg2rad(self._per_row(self.elevation_deg))
        index = np.indices(azimuth.shape, dtype=np.int32)
        firing_times = times + fired
        return Pattern(
            directions_at(azimuth, elevation),
            origins=self._origins(turned),
            firing_times=firing_times if firing_times.any() else None,
            ring=index[0],
            column=index[1],
        )

    def _origins(self, azimuth: NDArray[np.float64]) -> NDArray[np.float64] | None:
        if not self.origin_radius and self.origin_height is None:
            return None
        origins = self.origin_radius * directions_at(azimuth, np.zeros(1))
        origins[..., 2] = self._per_row(self.origin_height)
        return origins

    def _sweep(self) -> NDArray[np.float64]:
        """Azimuth of the head in each column (columns,) [rad]."""
        count = self.column_count
        if self.azimuth_deg is not None:
            begin, end = self.azimuth_deg
            if self._is_turn:  # whose end is where it began
                begin, end = (end, begin) if self.clockwise else (begin, end)
                return np.deg2rad(np.linspace(begin, end, count, endpoint=False, dtype=np.float64))
            sweep = np.deg2rad(np.linspace(begin, end, count, dtype=np.float64))
            return sweep[::-1] if self.clockwise else sweep
        step = 2 * np.pi / count
        if self.column_period_us is not None and self.rate_hz is not None:
            step = 2 * np.pi * 1e-6 * self.column_period_us * self.rate_hz
        return np.arange(count, dtype=np.float64) * (-step if self.clockwise else step)

    def _column_times(self) -> NDArray[np.float64]:
        """Time at which the first row of each column fires, (columns,) [s]."""
        count = self.column_count
        if self.column_period_us is not None:
            return np.arange(count, dtype=np.float64) * (1e-6 * self.column_period_us)
        return np.linspace(0.0, self._last_column_time, count, dtype=np.float64)

    @property
    def _last_column_time(self) -> float:
        """Time at which the first row of the last column fires [s]."""
        count = self.column_count
        if self.scan_time is not None:
            return self.scan_time
        if self.column_period_us is not None:
            return (count - 1) * 1e-6 * self.column_period_us
        if self.rate_hz is None or count == 1:
            return 0.0
        turned = (count - 1) / count
        if self.azimuth_deg is not None and not self._is_turn:
            turned = (self.azimuth_deg[1] - self.azimuth_deg[0]) / 360
        return turned / self.rate_hz

    @property
    def _is_turn(self) -> bool:
        """Whether the sector is a full turn, but for how its ends are rounded."""
        return self.azimuth_deg is not None and self.azimuth_deg[1] - self.azimuth_deg[0] >= 360 - 1e-9

    def _per_row(self, values: Sequence[float] | None) -> NDArray[np.float64]:
        """Values as a column (rows, 1), one per row; 0 if not given."""
        return np.zeros((len(self.elevation_deg), 1)) if values is None else np.array(values, dtype=float)[:, None]
