"""A sensor on a scene: where it is, and the rays of its readings on the device."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import NamedTuple

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import BYTES_PER_HIT
from rigcast.kernels.effects.random import RandomSource, random_source
from rigcast.kernels.mounts import Frames
from rigcast.kernels.packets.sorting import sort_into_packets
from rigcast.kernels.rays import Rays
from rigcast.sensors.physics.depth_camera import DepthPhysics
from rigcast.sensors.physics.lidar import LidarPhysics
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.scene.worlds import Standing
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan, yaw_only
from rigcast.sensors.specs.lidar import Lidar
from rigcast.sensors.specs.mount import BoundMount
from rigcast.sensors.specs.pattern import Pattern

Sensor = Lidar | DepthCamera | HeightScan


class WorldRays(NamedTuple):
    """The rays of one reading in the world, (*shape, 3) float64: origins [m] and unit directions."""

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mounted:
    """A sensor on a scene, with the rays of one reading on the device."""

    scene: Scene
    spec: Sensor
    mount: BoundMount
    pattern: Pattern
    fixed_rays: Rays
    firing_times: wp.array | None
    ring: wp.array | None
    column: wp.array | None
    physics: LidarPhysics | None
    depth_physics: DepthPhysics | None
    frames: Iterator[int]

    @staticmethod
    def on(scene: Scene, spec: Sensor) -> "Mounted":
        pattern = spec.pattern(scene.model)
        rays = _upload_rays(pattern, scene)
        return Mounted(
            scene,
            spec,
            spec.mount.bind(scene.model).turned(spec.frame_rotation),
            pattern,
            rays,
            _upload(pattern.firing_times, wp.float64, spec, scene.device),
            _upload(pattern.ring, wp.int32, spec, scene.device),
            _upload(pattern.column, wp.int32, spec, scene.device),
            LidarPhysics(scene, spec, rays) if isinstance(spec, Lidar) and spec.has_effects else None,
            DepthPhysics(scene, spec, pattern) if isinstance(spec, DepthCamera) and spec.has_effects else None,
            count(),
        )

    def at(self, time: float) -> "Mounted":
        """With the rays of a reading that begins at `time` [s], where a pattern is another one in each reading."""
        if self.pattern.later is None:
            return self
        pattern, device = self.pattern.at(time), self.scene.device
        rays = _upload_rays(pattern, self.scene)
        return replace(
            self,
            pattern=pattern,
            fixed_rays=rays,
            firing_times=_upload(pattern.firing_times, wp.float64, self.spec, device),
            ring=_upload(pattern.ring, wp.int32, self.spec, device),
            column=_upload(pattern.column, wp.int32, self.spec, device),
            physics=None if self.physics is None else self.physics.along(rays),
        )

    @property
    def bytes_per_world(self) -> int:
        """The most memory that one reading of one of many worlds takes, while it is made."""
        rays = math.prod(self.pattern.shape)
        if self.physics is not None:
            return rays * self.physics.bytes_per_ray
        if self.depth_physics is not None:
            return rays * self.depth_physics.bytes_per_ray
        return rays * BYTES_PER_HIT

    @property
    def _draws(self) -> bool:
        """Whether the sensor needs random numbers."""
        return self.physics is not None or self.depth_physics is not None

    @property
    def frame_shape(self) -> tuple[int, ...]:
        """That of a frame's fields: the pattern's, with a last axis for several returns."""
        copies = _returns(self.spec)
        return self.pattern.shape if copies == 1 else (*self.pattern.shape, copies)

    def pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """(4, 4) the sensor's frame in the world."""
        with np.errstate(invalid="ignore"):  # a pose with inf in it becomes NaN
            pose = self.mount.pose(data)
            return yaw_only(pose) if self.spec.yaw_aligned else pose

    def visible(self) -> wp.array:
        return self.scene.visible(self.spec.filter)

    def rays(self, data: mujoco.MjData) -> Rays:
        return self.scene.in_pose(self.fixed_rays, self.pose(data))

    def shot(self, data: mujoco.MjData, time: float) -> "Shot":
        """The next reading of the world that `data` shows, which begins at `time` [s]."""
        fired = self.at(time)
        number = next(self.frames) if self._draws else 0
        return Shot(fired, fired.rays(data), fired.pose(data), time, fired.frame_shape, number, None)

    def shot_in(self, worlds: Standing) -> "Shot":
        """The next reading of many worlds.

        Reading k of a sensor whose pattern is another one in each reading has that of time k / rate_hz, in all worlds.
        """
        number = next(self.frames)
        fired = self.at(number / self.spec.rate_hz if self.spec.rate_hz else number * self.pattern.duration)
        frames = Frames.empty(worlds.count, 1, self.scene.device)
        carriers = worlds.carriers(self.mount.parent)
        aligned, active = self.spec.yaw_aligned, worlds.active
        frames.place(0, carriers, self.mount.id, self.mount.offset, yaw_aligned=aligned, active=active)
        position, rotation = frames.position.flatten(), frames.rotation.flatten()
        rays = replace(fired.fixed_rays, position=position, rotation=rotation, worlds=worlds.count)
        shape = (worlds.count, *fired.frame_shape)
        return Shot(fired, rays, frames.poses(), worlds.times(), shape, number, worlds.ids)

    def world_rays(self, data: mujoco.MjData) -> WorldRays:
        pose = self.pose(data)
        directions = self.pattern.directions @ pose[:3, :3].T
        local = np.zeros(3) if self.pattern.origins is None else self.pattern.origins
        return WorldRays(np.broadcast_to(local @ pose[:3, :3].T + pose[:3, 3], directions.shape), directions)


@dataclass(frozen=True, eq=False)
class Shot:
    """One reading of a sensor, before its rays are cast, in one world or in many.

    sensor: with the pattern of this reading. rays: where it stands. pose, time, shape: as in its frame. number: how
    many it has made before. ids: (nworld,) of which the worlds draw their random numbers, None for one world.
    """

    sensor: Mounted
    rays: Rays
    pose: NDArray[np.float64] | wp.array
    time: float | wp.array
    shape: tuple[int, ...]
    number: int
    ids: wp.array | None

    def random(self, seed: int) -> RandomSource:
        """The random numbers of this reading."""
        count = math.prod(self.sensor.pattern.shape)
        return random_source(seed, self.sensor.spec.name, self.number, self.ids, count)

    def of_each_world(self, values: wp.array | None) -> wp.array | None:
        """What is the same in all worlds, with a first axis for them: no copy is made."""
        if values is None or self.ids is None:
            return values
        return same_in_each(values, self.ids.size)


def same_in_each(values: wp.array, worlds: int) -> wp.array:
    """(worlds, ...) of an array (...), which is there only once."""
    strides = (0, *values.strides)
    repeated = wp.array(
        ptr=values.ptr, dtype=values.dtype, shape=(worlds, *values.shape), strides=strides, device=values.device
    )
    repeated._ref = values  # which keeps the memory
    return repeated


def _upload_rays(pattern: Pattern, scene: Scene) -> Rays:
    """The rays of a pattern on the device; on the CPU in packets, where they leave from one origin.

    Those of a pattern that is another one in each reading are cast alone: sorting them would take longer.
    """
    origins = np.zeros((1, 3)) if pattern.origins is None else pattern.origins
    rays = scene.rays_in_frame(pattern.directions, origins, np.eye(4))
    if pattern.origins is not None or pattern.later is not None or not scene.device.is_cpu:
        return rays
    return replace(rays, packets=sort_into_packets(pattern.directions.reshape(-1, 3)))


def _upload(values: NDArray[np.generic] | None, dtype: type, spec: Sensor, device: wp.Device) -> wp.array | None:
    """Values of each ray on the device, repeated for each of its returns; None where there are none."""
    if values is None:
        return None
    copies = _returns(spec)
    every = values if copies == 1 else np.repeat(values[..., None], copies, axis=-1)
    return wp.array(every, dtype=dtype, device=device)


def _returns(spec: Sensor) -> int:
    """How many returns of a ray a frame has."""
    return 2 if isinstance(spec, Lidar) and spec.returns == "dual" else 1
