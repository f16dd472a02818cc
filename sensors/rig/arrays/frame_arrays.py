"""The arrays of a frame: its rays, their hits, and the launches that write them."""

from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import Readings
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.host.held import Held
from rigcast.kernels.host.views import view_as
from rigcast.kernels.poses.mounts import Frames
from rigcast.kernels.rays.arrays import Rays
from rigcast.sensors.scene.rays.placed import in_pose
from rigcast.sensors.scene.stage import Stage
from rigcast.sensors.specs.mount import Alignment, BoundMount

from .launches import Launches
from .lazy_fields import LazyFields

_MOST_AXES = 4  # of a Warp array
_SCALARS = {wp.vec3: wp.float32, wp.vec3d: wp.float64}


class FrameArrays:
    """The arrays of one frame of this shape, which a later reading writes over when nobody holds them any more.

    hits: of the present reading, one entry per ray. range, shape_hit: (...), normal: (..., 3): the same as a frame
    shows them. fields: what else a frame says. held: whether others hold any of them, as nobody does those of a reading
    that failed. is_part: whether they are part of the arrays of many worlds. cast: that of the last reading without
    errors.

    shared: launches for the first reading, which are turned to these arrays after others. Once arrays are written over
    they have launches of their own, which need not be turned each time. None: from the first reading on.
    """

    def __init__(
        self, hits: HitArrays, shape: tuple[int, ...], rays: Rays | None = None, shared: Launches | None = None
    ) -> None:
        self.hits, self.shape, self.is_part = hits, shape, False
        self.range = self.in_shape(hits.distance)
        self.shape_hit = self.in_shape(hits.shape)
        self.normal = self.in_shape(hits.normal)
        self.held = Held(hits.distance, hits.shape, hits.normal, self.range, self.shape_hit, self.normal)
        self.fields = LazyFields(self.held)
        self._used: list[object] = []
        self._launches, self._are_shared = shared or Launches(), shared is not None
        self._rays = rays
        # rays that are fixed to the sensor, and the same where it is:
        self._fixed: Rays | None = None
        self._aimed: Rays | None = None
        self.cast: Readings | None = None
        self._turned_to = frozenset[str]()  # which fields it writes

    @property
    def rays(self) -> Rays:
        """The rays of the present reading."""
        assert self._rays is not None
        return self._rays

    def start(self) -> None:
        """Begin another reading, of which no field has been requested yet."""
        self.fields.start()
        if self._are_shared:
            self._launches, self._are_shared, self._aimed = Launches(), False, None

    def start_again(self) -> None:
        """Begin another reading whose frame has the fields that were requested of the last one."""
        unanswered = self.fields.unanswered
        self.start()
        self.fields.request_again(unanswered)

    def aim(
        self, fixed: Rays, mount: BoundMount, alignment: Alignment, data: mujoco.MjData
    ) -> tuple[NDArray[np.float64], Rays]:
        """The pose (4, 4) of a sensor on this mount in `data`, and its rays at that pose."""
        pose, frame = self._launches.place(mount, alignment, data, self.range.device)
        if self._are_shared:  # so `frame` goes on to where other frames are: its pose is copied
            self._fixed, self._aimed = fixed, in_pose(fixed, pose)
            return pose, self._aimed
        return pose, self._aimed_at(frame.position, frame.rotation, 1, fixed)

    @cached_property
    def frames(self) -> Frames:
        """Frames for the sensor's poses in many worlds, and their times."""
        return Frames.empty(self.shape[0], 1, self.range.device, with_matrix=True)

    def aim_in_worlds(self, fixed: Rays) -> Rays:
        """The rays at the poses of `frames`."""
        self._rays = self._aimed_at(self.frames.position, self.frames.rotation, self.shape[0], fixed)
        return self._rays

    def _aimed_at(self, position: wp.array, rotation: wp.array, worlds: int, fixed: Rays) -> Rays:
        """The rays at these poses. The object is the same while `fixed` is; its pose arrays are always the same."""
        if self._aimed is None or fixed is not self._fixed:
            self._aimed = replace(fixed, position=position.flatten(), rotation=rotation.flatten(), worlds=worlds)
            self._fixed = fixed
        return self._aimed

    def readings(self, scene: Stage, rays: Rays, visible: wp.array, limits: tuple[float, float]) -> Readings:
        """Prepare a reading without errors within these limits [m], to be launched before anything else."""
        fixed = self._fixed if rays is self._aimed else rays
        readings = self._launches.prepared(scene, fixed, rays, visible, limits)
        fields = self.fields.for_cast
        if self._are_shared or readings is not self.cast or fields != self._turned_to:
            self.cast = None  # until it is turned whole
            readings.turn_to(self.hits, rays, self.fields.arrays(fields))
            self.cast, self._turned_to = readings, fields
            self.held.settle()
        self._rays, self.fields.written = rays, fields
        return readings

    def taken(self, rays: Rays) -> None:
        """Note that a reading with errors has been written to `hits`."""
        self._rays = rays
        self.held.settle()

    def keep(self, *used: object) -> None:
        """Hold what a reading has used, for a CUDA graph that repeats it while its frame exists."""
        self._used += used

    def in_shape(self, array: wp.array) -> wp.array:
        """A view with one entry per ray in the frame's shape: scalars (...), vectors (..., 3).

        Arrays of vectors keep shape (...) where a last axis of 3 would be one axis too many for Warp.
        """
        scalar = _SCALARS.get(array.dtype)
        if scalar is None or len(self.shape) == _MOST_AXES:
            return view_as(array, array.dtype, self.shape)
        return view_as(array, scalar, (*self.shape, 3))

    def of_worlds(self, part: slice) -> "FrameArrays":
        """Arrays for a reading of some of many worlds, in the same memory; self for all worlds."""
        worlds = self.shape[0]
        if part == slice(0, worlds):
            return self
        arrays = FrameArrays(self.hits.of_worlds(part, worlds), (part.stop - part.start, *self.shape[1:]))
        arrays.frames = self.frames.of_worlds(part)
        return arrays

    def of_world(self, k: int) -> "FrameArrays":
        """The arrays of one of many worlds, in the same memory."""
        part = slice(k, k + 1)
        arrays = FrameArrays(self.hits.of_worlds(part, self.shape[0]), self.shape[1:], self.rays.of_worlds(part))
        arrays.is_part = True
        return arrays
