"""Readings under way of moving sensors: begun at one step, finished at a later one."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from rigcast.sensors.scene.stage import Stage

from .arrays.frame_arrays import FrameArrays
from .mounted import Aim, Mounted
from .timing.motion import History, Knot, Track


class Begun(NamedTuple):
    """A reading that began at `time` [s] and is under way."""

    time: float
    mounted: Mounted

    @property
    def end(self) -> float:
        """The time at which its last ray is fired [s]."""
        firings = self.mounted.pattern.firings
        assert firings is not None
        return self.time + firings.end


class UnderWay:
    """The readings under way of one scene's moving sensors, and the steps that they span.

    rounding: for each sensor, how far [s] the clock may be short of a time that it has reached.
    """

    def __init__(self, scene: Stage, moving: Sequence[Mounted], rounding: Mapping[str, float]) -> None:
        self.moving = moving
        self._scene, self._rounding = scene, rounding
        self._history = History()
        self._begun: list[Begun] = []

    def start_over(self) -> None:
        """Discard all readings under way."""
        self._begun.clear()
        self._history.clear()

    def step(self, data: mujoco.MjData, due: Iterable[tuple[float, Mounted]]) -> list[Begun]:
        """Go on to the world of `data` and begin the due readings; return those whose last ray has been fired."""
        self._begun += [Begun(time, mounted) for time, mounted in due]
        self._history.forget_before(min([data.time, *(each.time for each in self._begun)]))
        poses = {m.spec.name: m.pose(data) for m in self.moving}
        self._history.add(Knot(data.time, self._scene.read(data), poses))
        over = [each for each in self._begun if each.end <= data.time + self._rounding[each.mounted.spec.name]]
        self._begun = [each for each in self._begun if each not in over]
        return over

    def aim(self, begun: Begun, arrays: FrameArrays) -> Aim:
        """Sweep the scene through the steps that a reading spans; return the reading's rays and arrays."""
        name, pattern = begun.mounted.spec.name, begun.mounted.pattern
        assert pattern.firings is not None
        knots = self._history.over(begun.time, begun.end)
        self._scene.sweep([knot.shapes for knot in knots])
        pose = Track.along(knots, name, np.array([begun.time])).pose()
        rays = pattern.rays_along(Track.along(knots, name, begun.time + pattern.firings.times))
        return Aim(begun.time, pose, rays, arrays)
