"""The arrays of frames, which a sensor hands out again once nobody holds them any more.

Who holds them is told as rigcast.kernels.host.held says; who holds a frame holds all of them.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from sys import getrefcount

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import BYTES_PER_HIT, HIT_NAMES, HitArrays, Readings
from rigcast.kernels.hits.out import FIELD_NAMES
from rigcast.kernels.host.held import references
from rigcast.kernels.host.taking import PlacedFrame
from rigcast.kernels.poses.mounts import Frames
from rigcast.kernels.rays.arrays import Rays
from rigcast.sensors.scene.rays.placed import in_pose
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.mount import BoundMount

_MOST = 8  # frames of a sensor whose arrays are kept
_MOST_AXES = 4  # of a Warp array
_BY_CAST, _NO_FIELDS = frozenset(FIELD_NAMES), frozenset[str]()


class Kept:
    """The arrays of one frame of this shape, each made when it is first asked for, then written over.

    rays: of the present reading. hits: what they hit. range, shape_hit: (...), normal: (..., 3), as a frame shows them.
    """

    def __init__(
        self, hits: HitArrays, shape: tuple[int, ...], rays: Rays | None = None, first: "FirstReadings | None" = None
    ) -> None:
        self.hits, self.shape = hits, shape
        self.is_part = False  # of those of many worlds
        self._first = first
        self.range = hits.distance.reshape(shape)
        self.shape_hit = hits.shape.reshape(shape)
        self.normal = self.vectors(hits.normal, wp.float32)
        self.asked: set[str] = set()
        self._rays = rays
        self._fixed: Rays | None = None
        self._frame: PlacedFrame | None = None
        self._mount: BoundMount | None = None
        self._frames: Frames | None = None
        self._readings: Readings | None = None
        self._prepared_for: tuple[Rays | None, wp.array | None] = (None, None)
        self._arrays: dict[str, wp.array] = {}
        self._fields: dict[str, wp.array] = {}
        self._current: set[str] = set()
        self._by_cast: frozenset[str] = frozenset()  # fields that the cast writes
        self._turned_to: frozenset[str] | None = None  # those that its launches are prepared to
        self._written: frozenset[str] = frozenset()  # those of the present reading
        self._held: list[object] = []
        # those that a frame gives, or whose parts the frame of one of many worlds does
        self._given = [hits.distance, hits.shape, hits.normal, self.range, self.shape_hit, self.normal]
        self._at_first: list[int] = []

    @staticmethod
    def empty(shape: tuple[int, ...], device: wp.Device, first: "FirstReadings | None" = None) -> "Kept":
        return Kept(HitArrays.empty(math.prod(shape), device), shape, first=first)

    @property
    def rays(self) -> Rays:
        assert self._rays is not None
        return self._rays

    @property
    def is_free(self) -> bool:
        """Whether nobody holds any of the arrays."""
        if not self._at_first:  # a reading that failed has not given any of it to anybody
            return True
        return references(self._given) == self._at_first

    def start(self) -> None:
        """Begin another reading: what was worked out of the last one does not hold any more, but was `asked` for."""
        self.asked = self._begin()

    def start_over(self) -> None:
        """Begin a reading of which nothing has been asked for yet."""
        self._begin()
        self.asked = set()

    def _begin(self) -> set[str]:
        """What was asked of the last reading: the next cast writes as much of it as it can, in less time than later."""
        asked, self._current, self._written = self._current, set(), _NO_FIELDS
        self._by_cast, self._first = _BY_CAST & asked, None
        return asked

    def aim(
        self, fixed: Rays, mount: BoundMount, yaw_aligned: bool, data: mujoco.MjData
    ) -> tuple[NDArray[np.float64], Rays]:
        """Where a sensor on this mount is in `data`, (4, 4), and its rays there."""
        if self._first is not None:
            pose = self._first.pose(mount, yaw_aligned, data)
            self._rays, self._fixed = in_pose(fixed, pose), fixed
            return pose, self._rays
        if self._frame is None or self._mount is not mount:
            self._frame = PlacedFrame(mount.id, mount.offset, yaw_aligned, self.hits.distance.device)
            self._mount, self._fixed = mount, None
        pose = self._frame.place(*mount.carriers(data))
        return pose, self._placed(fixed, self._frame.position, self._frame.rotation, 1)

    def frames(self, worlds: int) -> Frames:
        """For the sensor's pose in so many worlds."""
        if self._frames is None:
            self._frames = Frames.empty(worlds, 1, self.hits.distance.device)
        return self._frames

    def part(self, part: slice) -> "Kept":
        """Those of some of many worlds, without a copy; itself, of all."""
        worlds = self.shape[0]
        if part == slice(0, worlds):
            return self
        kept = Kept(self.hits.of_worlds(part, worlds), (part.stop - part.start, *self.shape[1:]))
        kept._frames = self.frames(worlds).of_worlds(part)
        return kept

    def aim_in_worlds(self, fixed: Rays) -> Rays:
        """Those rays in the poses of `frames`."""
        assert self._frames is not None
        position, rotation = self._frames.position, self._frames.rotation
        return self._placed(fixed, position, rotation, position.shape[0])

    def _placed(self, fixed: Rays, position: wp.array, rotation: wp.array, worlds: int) -> Rays:
        if self._rays is None or self._fixed is not fixed:
            self._rays = replace(fixed, position=position.flatten(), rotation=rotation.flatten(), worlds=worlds)
            self._fixed = fixed
        return self._rays

    def read(self, scene: Scene, rays: Rays, visible: wp.array, limits: tuple[float, float]) -> None:
        """A reading without errors, of what is between these limits [m]."""
        if self._first is not None and self._fixed is not None:
            readings = self._first.readings(scene, self._fixed, rays, visible, limits)
            readings.turn_to(self.hits, rays, {})
        else:
            readings = self._own_readings(scene, rays, visible, limits)
        for launch in readings.launches:
            launch()
        self._written = self._by_cast
        self.settle()

    def _own_readings(self, scene: Scene, rays: Rays, visible: wp.array, limits: tuple[float, float]) -> Readings:
        if self._readings is None or rays is not self._prepared_for[0] or visible is not self._prepared_for[1]:
            self._readings = scene.prepare_readings(rays, visible, limits)
            self._rays, self._prepared_for, self._turned_to = rays, (rays, visible), None
        if self._turned_to != self._by_cast:
            self._readings.turn_to(self.hits, rays, {name: self._arrays[name] for name in self._by_cast})
            self._turned_to = self._by_cast
        return self._readings

    @property
    def launches(self) -> Sequence[Callable[[], object]]:
        """Those of the last reading, which hold what they read."""
        return [] if self._readings is None else self._readings.launches

    def hold(self, *used: object) -> None:
        """Keep what a reading has used, for a graph that repeats it for as long as its frame is there."""
        self._held += used

    def take(self, hits: HitArrays, rays: Rays) -> None:
        """A reading of other arrays, copied here."""
        for name in HIT_NAMES:
            wp.copy(getattr(self.hits, name), getattr(hits, name))
        self._rays, self._fixed = rays, None
        self.settle()

    def field(
        self,
        name: str,
        work_out: Callable[[wp.array | None], wp.array],
        shown: Callable[[wp.array], wp.array] = lambda array: array,
    ) -> wp.array:
        """What is worked out of a reading once, into the array that it was worked out into before, and how it shows."""
        if name not in self._current:
            if name not in self._written:
                self._work_out(name, work_out, shown)
            self._current.add(name)
            self._at_first += references(self._given)[len(self._at_first) :]
        return self._fields[name]

    def _work_out(
        self, name: str, work_out: Callable[[wp.array | None], wp.array], shown: Callable[[wp.array], wp.array]
    ) -> None:
        known = self._arrays.get(name)
        array = work_out(known)
        if array is not known:
            self._arrays[name], self._fields[name] = array, shown(array)
            self._given += [array, self._fields[name]]

    def scalars(self, array: wp.array) -> wp.array:
        """n values in the frame's shape."""
        return array.reshape(self.shape)

    def vectors(self, array: wp.array, scalar: type) -> wp.array:
        """n vectors as scalars of shape (..., 3), without a copy; as vectors where that is one axis too many."""
        if len(self.shape) == _MOST_AXES:
            return array.reshape(self.shape)
        return array.view(scalar).reshape((*self.shape, 3))

    def of_world(self, k: int) -> "Kept":
        """Those of one of many worlds, without a copy."""
        part = slice(k, k + 1)
        kept = Kept(self.hits.of_worlds(part, self.shape[0]), self.shape[1:], self.rays.of_worlds(part))
        kept.is_part = True
        return kept

    def settle(self) -> None:
        """Take note of who holds the arrays now: nobody but this, and what shares its life."""
        if not self._at_first:  # nobody can hold any of it yet
            self._at_first = references(self._given)


class FirstReadings:
    """Of one sensor on the CPU: the readings into arrays that nothing has been read into before.

    They share their launches. To prepare these takes longer than a small frame, and if frames are all kept, nothing is
    read into their arrays again.
    """

    def __init__(self) -> None:
        self._readings: Readings | None = None
        self._prepared_for: tuple[Rays | None, wp.array | None, int] = (None, None, 0)
        self._frame: PlacedFrame | None = None
        self._mount: BoundMount | None = None

    def pose(self, mount: BoundMount, yaw_aligned: bool, data: mujoco.MjData) -> NDArray[np.float64]:
        """Where a sensor on this mount is in `data`, (4, 4)."""
        if self._frame is None or self._mount is not mount:
            self._frame, self._mount = PlacedFrame(mount.id, mount.offset, yaw_aligned, wp.get_device("cpu")), mount
        return self._frame.place(*mount.carriers(data))

    def readings(
        self, scene: Scene, fixed: Rays, rays: Rays, visible: wp.array, limits: tuple[float, float]
    ) -> Readings:
        """Of these rays, which are the fixed ones where the sensor is now."""
        known = self._prepared_for
        if self._readings is None or fixed is not known[0] or visible is not known[1] or rays.worlds != known[2]:
            self._readings = scene.prepare_readings(rays, visible, limits)
            self._prepared_for = fixed, visible, rays.worlds
        return self._readings


class Pool:
    """The arrays of the last few frames of one sensor."""

    def __init__(self) -> None:
        self._kept: deque[Kept] = deque(maxlen=_MOST)
        self._first = FirstReadings()

    @property
    def free_bytes(self) -> int:
        """Of the hits in arrays that nobody holds."""
        return sum(BYTES_PER_HIT * math.prod(self._kept[k].shape) for k in range(len(self._kept)) if self._is_free(k))

    def take(self, shape: tuple[int, ...], device: wp.Device) -> Kept:
        """Arrays for a frame of this shape: those of the latest one that nobody holds any more, or new ones.

        Those of another shape that nobody holds make room for new ones.
        """
        for k in reversed(range(len(self._kept))):
            if self._kept[k].shape == shape and self._is_free(k):
                kept = self._kept[k]
                del self._kept[k]
                kept.start_over()
                break
        else:
            for k in reversed(range(len(self._kept))):
                if self._kept[k].shape != shape and self._is_free(k):
                    del self._kept[k]
            kept = Kept.empty(shape, device, self._first if device.is_cpu else None)
        self._kept.append(kept)
        return kept

    def _is_free(self, k: int) -> bool:
        return getrefcount(self._kept[k]) == _ALONE and self._kept[k].is_free


_SOME = deque([object()])
_ALONE = getrefcount(_SOME[0])
"""References to what only a deque holds."""
