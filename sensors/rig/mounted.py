"""A sensor on a scene: its pose, and the rays of its readings on the device."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import NamedTuple

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.hits.arrays import BYTES_PER_HIT
from rigcast.kernels.poses.mounts import BYTES_PER_FRAME
from rigcast.kernels.rays.arrays import Rays
from rigcast.sensors.physics.physics import Physics
from rigcast.sensors.scene.batch.per_world import PerWorld
from rigcast.sensors.scene.batch.posed_worlds import PosedWorlds
from rigcast.sensors.scene.batch.world_mounts import WorldMounts
from rigcast.sensors.scene.batch.worlds import Worlds
from rigcast.sensors.scene.rays.placed import in_pose
from rigcast.sensors.scene.stage import Stage
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import BoundMount, aligned
from rigcast.sensors.specs.pattern import Pattern

from .arrays.frame_arrays import FrameArrays
from .arrays.pool import Pool
from .device_pattern import DevicePattern
from .frame import Frame, Source

Sensor = Lidar | DepthCamera | HeightScan


class WorldRays(NamedTuple):
    """The rays of one reading in the world, (*shape, 3) float64: origins [m] and unit directions."""

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]


class Aim(NamedTuple):
    """The rays of a reading that begins at `time` [s], the sensor's pose (4, 4) at that time, and the frame's arrays.

    For many worlds time and pose are (nworld,) and (nworld, 4, 4).
    """

    time: float | wp.array
    pose: NDArray[np.float64] | wp.array
    rays: Rays
    arrays: FrameArrays


@dataclass(frozen=True, eq=False)
class Mounted:
    """A sensor on a scene.

    frames: counts readings with errors. batches: counts readings of many worlds. pool: the arrays of its frames.
    """

    scene: Stage
    spec: Sensor
    mount: BoundMount
    pattern: DevicePattern
    physics: Physics | None
    frames: Iterator[int]
    batches: Iterator[int]
    pool: Pool
    filter: Filter | PerWorld[Filter]
    mount_in_worlds: WorldMounts

    @staticmethod
    def on(scene: Stage, spec: Sensor) -> "Mounted":
        pattern = spec.pattern(scene.model)
        on_device = DevicePattern.of(spec, pattern, scene.device)
        mount = spec.mount.bind(scene.model).turned(spec.frame_rotation)
        return Mounted(
            scene,
            spec,
            mount,
            on_device,
            _physics(scene, spec, pattern),
            count(),
            count(),
            Pool(),
            spec.filter,
            WorldMounts.by([mount], scene.device),
        )

    def at(self, time: float) -> "Mounted":
        """The sensor with its rays in the reading that begins at `time` [s]; some patterns change with each reading."""
        return self if self.pattern.given.later is None else replace(self, pattern=self.pattern.at(time))

    def afresh(self) -> "Mounted":
        """The sensor with its counts of readings started over."""
        return replace(self, frames=count(), batches=count())

    def bytes_per_world(self, worlds: Worlds) -> int:
        """Upper bound on the memory [bytes] of one reading of one of many worlds."""
        # of positions and rotations: the sensor's, its carrier's, the frame's (4, 4), which takes less than two, and
        # those of mounts that differ
        poses = 4 + (self.spec.name in worlds.mounts)
        visible = self.scene.body_of_shape.size if worlds.differ_in_sight(self.spec.name) else 0
        hits = BYTES_PER_HIT * math.prod(self.pattern.frame_shape)
        errors = 0 if self.physics is None else self.physics.kept_bytes_per_ray * math.prod(self.pattern.shape)
        return poses * BYTES_PER_FRAME + visible + hits + errors

    @property
    def bytes_per_posed_world(self) -> int:
        """Upper bound on the memory [bytes] for errors per world that is read at one time; much of it is kept."""
        return 0 if self.physics is None else self.physics.bytes_per_ray * math.prod(self.pattern.shape)

    @cached_property
    def source(self) -> Source:
        """The data shared by its frames."""
        scene, pattern = self.scene, self.pattern
        of_rays = pattern.firing_times, pattern.ring, pattern.column
        return Source(self.spec.name, scene.shape_ids, scene.body_of_shape, *of_rays, pattern.given)

    def pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """The pose (4, 4) of the sensor's frame in the world."""
        return aligned(self.mount.pose(data), self.spec.frame_alignment)

    def visible(self) -> wp.array:
        return self.scene.visible(self.filter)

    def rays(self, data: mujoco.MjData) -> Rays:
        """The sensor's rays, all fired now."""
        return in_pose(self.pattern.rays, self.pose(data))

    def aim(self, data: mujoco.MjData, time: float, arrays: FrameArrays) -> Aim:
        """The sensor's rays, all fired now, for a reading at `time` [s]."""
        pose, rays = arrays.aim(self.pattern.rays, self.mount, self.spec.frame_alignment, data)
        return Aim(time, pose, rays, arrays)

    def next_of_worlds(self, worlds: Worlds) -> "Mounted":
        """The sensor with the pattern of its next reading of many worlds, and its filter there.

        If the pattern changes with each reading, that of reading k is the one at time k / rate_hz, in all worlds.
        """
        number = next(self.batches)
        time = number / self.spec.rate_hz if self.spec.rate_hz else number * self.pattern.given.duration
        fired, filter = self.at(time), worlds.filter_of(self.spec)
        return fired if filter is fired.filter else replace(fired, filter=filter)

    def aim_in_worlds(self, worlds: PosedWorlds, arrays: FrameArrays) -> Rays:
        """The sensor's rays at its poses in these worlds."""
        at = worlds.mounts_of(self.spec, self.mount_in_worlds)
        arrays.frames.place(
            0,
            worlds.carriers(at),
            at.on,
            alignment=self.spec.frame_alignment,
            active=worlds.active,
            time=worlds.time,
        )
        return arrays.aim_in_worlds(self.pattern.rays)

    def next_arrays(self, shape: tuple[int, ...], out: Mapping[str, Frame] | None = None) -> FrameArrays:
        """The arrays for its next frame, of this shape: of its frame in `out`, else of a frame that nobody holds."""
        if out is None:
            return self.pool.take(shape, self.scene.device)
        return out[self.spec.name].start_again()

    def world_rays(self, data: mujoco.MjData) -> WorldRays:
        pose = self.pose(data)
        given = self.pattern.given
        directions = given.directions @ pose[:3, :3].T
        local = np.zeros(3) if given.origins is None else given.origins
        return WorldRays(np.broadcast_to(local @ pose[:3, :3].T + pose[:3, 3], directions.shape), directions)


def _physics(scene: Stage, spec: Sensor, pattern: Pattern) -> Physics | None:
    """The sensor's physics; None without effects. Imported here, so that such a sensor does not load their kernels."""
    if isinstance(spec, Lidar) and spec.has_effects:
        from rigcast.sensors.physics.lidar import LidarPhysics

        return LidarPhysics(scene, spec, pattern.directions.size // 3)
    if isinstance(spec, DepthCamera) and spec.has_effects:
        from rigcast.sensors.physics.depth_camera import DepthPhysics

        return DepthPhysics(scene, spec, pattern)
    return None
