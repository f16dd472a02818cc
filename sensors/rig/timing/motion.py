"""Readings that take time: poses of shapes and sensors at the steps that they span, and at the firing of each ray.

Between two steps, positions move on a straight line and rotations along the shortest arc, at constant rates.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.packing.firings import same_rows
from rigcast.sensors.rotations import quaternion
from rigcast.sensors.scene.parts.part import ShapePoses

SLOT, PACKED_SLOT = 2e-5, 1e-4
"""Times [s]. Rays fired within SLOT leave from one pose; a sensor at 10 m/s moves 0.2 mm in this time. Where packets
would hold too few of them, those within PACKED_SLOT, in which it goes 1 mm."""
FEWEST = 32
"""Least average number of rays per firing for packets."""

Doubles = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Firings:
    """The firings of a reading: sets of rays that leave at one time from one pose of the sensor.

    of_ray: (n,) int32, the firing of each ray. times: (firings,) [s] since the reading's begin, ascending, the middle
    of those of its rays. end: when the last ray is fired [s].
    """

    of_ray: NDArray[np.int32]
    times: Doubles
    end: float

    @staticmethod
    def of(times: Doubles, *, packed: bool) -> "Firings":
        """The firings of rays that are fired at these times (n,) [s]. packed: whether they are cast in packets."""
        firings = Firings._in_slots(times, SLOT)
        if packed and len(times) < FEWEST * len(firings.times):
            return Firings._in_slots(times, PACKED_SLOT)
        return firings

    @staticmethod
    def _in_slots(times: Doubles, slot: float) -> "Firings":
        # rounding may leave a multiple of a period just below the slot that it begins
        of_ray = same_rows(np.floor(times / slot + 1e-6)[:, None])
        first, last = np.full(of_ray.max() + 1, np.inf), np.full(of_ray.max() + 1, -np.inf)
        np.minimum.at(first, of_ray, times)
        np.maximum.at(last, of_ray, times)
        return Firings(of_ray, (first + last) / 2, float(times.max()))


@dataclass(frozen=True, eq=False)
class Knot:
    """A simulation step: its time [s], the poses of all shapes, and the poses (4, 4) of moving sensors by name."""

    time: float
    shapes: ShapePoses
    sensors: Mapping[str, Doubles]


class History:
    """The steps that readings under way span, and the latest."""

    def __init__(self) -> None:
        self._knots: list[Knot] = []

    def add(self, knot: Knot) -> None:
        self._knots.append(knot)

    def clear(self) -> None:
        self._knots.clear()

    def forget_before(self, time: float) -> None:
        """Keep no step before the last one at or before this time [s]."""
        del self._knots[: max(self._after(time) - 1, 0)]

    def over(self, begin: float, end: float) -> list[Knot]:
        """The steps, at least two, from the last at or before `begin` [s] to the first at or after `end` [s].

        Before the first step, and after the last, poses are taken as constant.
        """
        first = max(self._after(begin) - 1, 0)
        last = next((k for k, knot in enumerate(self._knots) if knot.time >= end), len(self._knots) - 1)
        knots = self._knots[first : last + 1]
        return knots if len(knots) > 1 else [*knots, *knots]

    def _after(self, time: float) -> int:
        """Number of steps at or before this time."""
        return sum(knot.time <= time for knot in self._knots)


@dataclass(frozen=True, eq=False)
class Track:
    """Poses of a sensor at n times, position (n, 3) [m] and rotation (n, 3, 3), and these times relative to steps.

    span: (n,) int32, index of the step before. fraction: (n,) from 0 at that step to 1 at the next.
    """

    position: Doubles
    rotation: Doubles
    span: NDArray[np.int32]
    fraction: Doubles

    @staticmethod
    def along(knots: Sequence[Knot], sensor: str, times: Doubles) -> "Track":
        """The track of one sensor at these times (n,) [s], over at least two steps."""
        steps = np.array([knot.time for knot in knots])
        span = np.clip(np.searchsorted(steps, times, side="right") - 1, 0, len(steps) - 2)
        duration = steps[span + 1] - steps[span]
        since = np.clip(times - steps[span], 0.0, duration)
        fraction = np.divide(since, duration, out=np.zeros_like(times), where=duration > 0)
        poses = np.array([knot.sensors[sensor] for knot in knots])
        position, weight = poses[:, :3, 3], fraction[:, None]
        turns = _quaternions(poses[:, :3, :3])
        return Track(
            position[span] * (1 - weight) + position[span + 1] * weight,
            _matrices(slerp(turns[span], turns[span + 1], fraction)),
            span.astype(np.int32),
            fraction,
        )

    def pose(self) -> Doubles:
        """The pose (4, 4) at the first time."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation[0], self.position[0]
        return pose


def slerp(start: Doubles, end: Doubles, fraction: Doubles) -> Doubles:
    """Unit quaternions (n, 4) on the shortest arc between two (n, 4), at fractions (n,) of it.

    (sin((1 - f) a) q0 + sin(f a) q1) / sin a, a the angle between q0 and q1 (Shoemake, SIGGRAPH 1985).
    """
    cosine = (start * end).sum(axis=1)
    near = np.where(cosine < 0, -1.0, 1.0)
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.sin(angle)
    is_small = sine < 1e-6  # where it is linear to 1e-12
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.where(is_small, 1 - fraction, np.sin((1 - fraction) * angle) / sine)
        second = np.where(is_small, fraction, np.sin(fraction * angle) / sine)
    mixed = first[:, None] * start + (near * second)[:, None] * end
    return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))


def _quaternions(matrices: Doubles) -> Doubles:
    """Quaternions (n, 4) w, x, y, z of rotation matrices (n, 3, 3); NaN where one is not finite."""
    return np.array([quaternion(m) if np.isfinite(m).all() else np.full(4, np.nan) for m in matrices])


def _matrices(quaternions: Doubles) -> Doubles:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4)."""
    w, x, y, z = quaternions.T
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
