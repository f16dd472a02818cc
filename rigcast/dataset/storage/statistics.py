"""Statistics of frames that do not depend on the order of summation."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rigcast.sensors.rig.frame import CameraFrame, Frame

_MICRONS = 1e6


@dataclass
class SensorStatistics:
    """Statistics of one sensor in one episode: times of frames [s], numbers of rays and hits, finite ranges [m]."""

    type: str
    times: list[float] = field(default_factory=list)
    intrinsics: list[list[float]] | None = None
    rays: int = 0
    hits: int = 0
    least: float = np.inf
    most: float = -np.inf
    _sum: int = 0  # sum of ranges in whole micrometres, exact in any order

    def add(self, frame: Frame) -> None:
        ranges = frame.range.numpy()
        finite = ranges[np.isfinite(ranges)]
        self.times.append(float(frame.time))
        if isinstance(frame, CameraFrame):
            self.intrinsics = frame.intrinsics.tolist()
        self.rays += ranges.size
        self.hits += finite.size
        if finite.size:
            self.least, self.most = min(self.least, float(finite.min())), max(self.most, float(finite.max()))
            self._sum += int(np.rint(finite.astype(np.float64) * _MICRONS).astype(np.int64).sum())

    def entry(self) -> dict[str, Any]:
        """The statistics as plain values; without hits there is no range."""
        ranges = [self.least, self._sum / _MICRONS / self.hits, self.most] if self.hits else None
        counts = {"frames": len(self.times), "rays": self.rays, "hits": self.hits}
        return {"type": self.type, **counts, "range": ranges, "intrinsics": self.intrinsics, "times": self.times}


def combined(entries: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """The statistics of all episodes by sensor; range is [least, mean, most] [m], None without hits."""
    total: dict[str, dict[str, Any]] = {}
    for entry in entries:
        for name, one in entry["sensors"].items():
            so_far = total.setdefault(name, {"frames": 0, "rays": 0, "hits": 0, "range": None})
            so_far["range"] = _joint_range(so_far, one)
            for key in ("frames", "rays", "hits"):
                so_far[key] += one[key]
    return total


def _joint_range(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[float] | None:
    if not one["hits"] or not other["hits"]:
        return one["range"] or other["range"]
    (a, mean_a, b), (c, mean_c, d) = one["range"], other["range"]
    return [min(a, c), (one["hits"] * mean_a + other["hits"] * mean_c) / (one["hits"] + other["hits"]), max(b, d)]
