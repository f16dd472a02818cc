"""A sensor on a scene: where it is, and the rays of its readings on the device."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import BYTES_PER_HIT
from rigcast.kernels.packing.bundling import sort_into_bundles
from rigcast.kernels.packing.firings import groups_of, same_rows
from rigcast.kernels.packing.in_order import pack_in_order
from rigcast.kernels.packing.sorting import Packets
from rigcast.kernels.packing.warps import EVEN, LEVEL, Warps, sort_into_warps
from rigcast.kernels.poses.mounts import BYTES_PER_FRAME
from rigcast.kernels.rays.arrays import Rays
from rigcast.sensors.captured import is_captured
from rigcast.sensors.errors import InputError
from rigcast.sensors.scene.batch.attached import Attached
from rigcast.sensors.scene.batch.per_world import PerWorld
from rigcast.sensors.scene.batch.standing import Standing
from rigcast.sensors.scene.batch.worlds import Worlds
from rigcast.sensors.scene.cache.packets import cached_packets
from rigcast.sensors.scene.rays.given import lend
from rigcast.sensors.scene.rays.placed import in_pose, rays_in_frame
from rigcast.sensors.scene.stage import Stage
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.height_scan import HeightScan, yaw_only
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import BoundMount
from rigcast.sensors.specs.pattern import Pattern

from .frame import Source
from .frame_arrays import FrameArrays
from .motion import FEWEST, Firings, Track
from .pool import Pool

if TYPE_CHECKING:
    from rigcast.sensors.physics.depth_camera import DepthPhysics
    from rigcast.sensors.physics.lidar import LidarPhysics

Sensor = Lidar | DepthCamera | HeightScan


class WorldRays(NamedTuple):
    """The rays of one reading in the world, (*shape, 3) float64: origins [m] and unit directions."""

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]


class Aim(NamedTuple):
    """The rays of a reading that begins at `time` [s], the pose (4, 4) in which the sensor is then, and its arrays.

    Of many worlds these are (nworld,) and (nworld, 4, 4).
    """

    time: float | wp.array
    pose: NDArray[np.float64] | wp.array
    rays: Rays
    arrays: FrameArrays


@dataclass(frozen=True, eq=False)
class Mounted:
    """A sensor on a scene, with the rays of one reading on the device.

    firings: of a sensor that moves during a reading, None of others. rays_at_once: as if all were fired at one time.
    frames: numbers readings whose errors are drawn, batches: those of many worlds. pool: the arrays of its frames.
    """

    scene: Stage
    spec: Sensor
    mount: BoundMount
    pattern: Pattern
    firings: Firings | None
    rays_at_once: Rays
    firing_times: wp.array | None
    ring: wp.array | None
    column: wp.array | None
    physics: "LidarPhysics | None"
    depth_physics: "DepthPhysics | None"
    frames: Iterator[int]
    batches: Iterator[int]
    pool: Pool
    filter: Filter | PerWorld[Filter]
    attached: Attached

    @staticmethod
    def on(scene: Stage, spec: Sensor) -> "Mounted":
        pattern = spec.pattern(scene.model)
        rays = _upload_rays(pattern, scene)
        mount = spec.mount.bind(scene.model).turned(spec.frame_rotation)
        return Mounted(
            scene,
            spec,
            mount,
            pattern,
            _firings(spec, pattern, scene),
            rays,
            _upload(pattern.firing_times, wp.float64, spec, scene.device),
            _upload(pattern.ring, wp.int32, spec, scene.device),
            _upload(pattern.column, wp.int32, spec, scene.device),
            _lidar_physics(scene, spec, rays.directions.size),
            _depth_physics(scene, spec, pattern),
            count(),
            count(),
            Pool(),
            spec.filter,
            Attached.by([mount], scene.device),
        )

    def at(self, time: float) -> "Mounted":
        """With the rays of a reading that begins at `time` [s], where a pattern is another one in each reading."""
        if self.pattern.later is None:
            return self
        scene, spec = self.scene, self.spec
        pattern = self.pattern.at(time, in_packets=scene.device.is_cpu)
        if is_captured(scene.device):
            what = "got a pattern that is another one in each reading while a CUDA graph is captured"
            raise InputError(f"sensor {spec.name!r}: {what}, expected one that stays")
        rays = replace(self.rays_at_once, directions=lend(pattern.directions, scene.device), packets=None)
        turned = replace(self, pattern=pattern, rays_at_once=_packed(pattern, rays, scene))
        if all(getattr(pattern, name) is getattr(self.pattern, name) for name in ("firing_times", "ring", "column")):
            return turned
        return replace(
            turned,
            firings=_firings(spec, pattern, scene),
            firing_times=_upload(pattern.firing_times, wp.float64, spec, scene.device),
            ring=_upload(pattern.ring, wp.int32, spec, scene.device),
            column=_upload(pattern.column, wp.int32, spec, scene.device),
        )

    @cached_property
    def rays_fired(self) -> Rays:
        """The rays of a sensor that moves, each with its firing."""
        assert self.firings is not None
        rays = replace(self.rays_at_once, firing=wp.array(self.firings.of_ray, dtype=int, device=self.scene.device))
        if self.scene.device.is_cuda:
            return rays
        return replace(rays, packets=_packets(self.pattern, rays) if self.pattern.origins is None else None)

    def bytes_per_world(self, worlds: Worlds) -> int:
        """The most memory that one reading of one of many worlds takes."""
        # its pose and its carrier's, the frame's, which is a third larger, and how it is mounted
        poses = 4 + (self.spec.name in worlds.mounts)
        visible = self.scene.body_of_shape.size if worlds.differ_in_sight(self.spec.name) else 0
        physics = self.physics or self.depth_physics
        per_ray = _returns(self.spec) * BYTES_PER_HIT + (0 if physics is None else physics.kept_bytes_per_ray)
        return poses * BYTES_PER_FRAME + visible + math.prod(self.pattern.shape) * per_ray

    @property
    def bytes_per_standing_world(self) -> int:
        """The most that errors take in each of the worlds that are read at one time."""
        physics = self.physics or self.depth_physics
        return 0 if physics is None else math.prod(self.pattern.shape) * physics.bytes_per_ray

    @cached_property
    def frame_shape(self) -> tuple[int, ...]:
        """That of a frame's fields: the pattern's, with a last axis for several returns."""
        copies = _returns(self.spec)
        return self.pattern.shape if copies == 1 else (*self.pattern.shape, copies)

    @cached_property
    def source(self) -> Source:
        """What its frames share."""
        scene = self.scene
        return Source(self.spec.name, scene.shape_ids, scene.body_of_shape, self.firing_times, self.pattern)

    def pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """(4, 4) the sensor's frame in the world."""
        pose = self.mount.pose(data)
        if not self.spec.yaw_aligned:
            return pose
        with np.errstate(invalid="ignore"):
            return yaw_only(pose)

    def visible(self) -> wp.array:
        return self.scene.visible(self.filter)

    def rays(self, data: mujoco.MjData) -> Rays:
        """Its rays, all fired now."""
        return in_pose(self.rays_at_once, self.pose(data))

    def aim(self, data: mujoco.MjData, time: float, arrays: FrameArrays) -> Aim:
        """Its rays, all fired now, for a reading at `time` [s]."""
        pose, rays = arrays.aim(self.rays_at_once, self.mount, self.spec.yaw_aligned, data)
        return Aim(time, pose, rays, arrays)

    def rays_along(self, track: Track) -> Rays:
        """The rays of a sensor that moves, which is on this track at the times of its firings."""
        device = self.scene.device
        return replace(
            self.rays_fired,
            position=wp.array(track.position, dtype=wp.vec3d, device=device),
            rotation=wp.array(track.rotation, dtype=wp.mat33d, device=device),
            span=wp.array(track.span, dtype=int, device=device),
            fraction=wp.array(track.fraction, dtype=wp.float64, device=device),
        )

    def next_of_worlds(self, worlds: Worlds) -> "Mounted":
        """With the pattern of its next reading of many worlds, and the filter that it has there.

        Where a pattern is another one in each reading, that of reading k is the one of time k / rate_hz, in all worlds.
        """
        number = next(self.batches)
        fired = self.at(number / self.spec.rate_hz if self.spec.rate_hz else number * self.pattern.duration)
        ring, column = _same_in_each(fired.ring, worlds.count), _same_in_each(fired.column, worlds.count)
        return replace(fired, ring=ring, column=column, filter=worlds.filter_of(self.spec))

    def aim_in_worlds(self, worlds: Standing, arrays: FrameArrays) -> Rays:
        """Its rays, where it is in these worlds."""
        at = worlds.attached(self.spec, self.attached)
        arrays.frames.place(0, worlds.carriers(at), at.on, yaw_aligned=self.spec.yaw_aligned, active=worlds.active)
        return arrays.aim_in_worlds(self.rays_at_once)

    def world_rays(self, data: mujoco.MjData) -> WorldRays:
        pose = self.pose(data)
        directions = self.pattern.directions @ pose[:3, :3].T
        local = np.zeros(3) if self.pattern.origins is None else self.pattern.origins
        return WorldRays(np.broadcast_to(local @ pose[:3, :3].T + pose[:3, 3], directions.shape), directions)


def _same_in_each(values: wp.array | None, worlds: int) -> wp.array | None:
    """(worlds, ...) of an array (...), which is there only once."""
    if values is None:
        return None
    shape, strides = (worlds, *values.shape), (0, *values.strides)
    repeated = wp.array(ptr=values.ptr, dtype=values.dtype, shape=shape, strides=strides, device=values.device)
    repeated._ref = values  # which keeps the memory
    return repeated


def _lidar_physics(scene: Stage, spec: Sensor, count: int) -> "LidarPhysics | None":
    if not isinstance(spec, Lidar) or not spec.has_effects:
        return None
    from rigcast.sensors.physics.lidar import LidarPhysics  # here, as sensors without effects need none of its kernels

    return LidarPhysics(scene, spec, count)


def _depth_physics(scene: Stage, spec: Sensor, pattern: Pattern) -> "DepthPhysics | None":
    if not isinstance(spec, DepthCamera) or not spec.has_effects:
        return None
    from rigcast.sensors.physics.depth_camera import DepthPhysics  # here, as for lidars

    return DepthPhysics(scene, spec, pattern)


def _firings(spec: Sensor, pattern: Pattern, scene: Stage) -> Firings | None:
    if not spec.moves:
        return None
    times = np.zeros(pattern.shape) if pattern.firing_times is None else pattern.firing_times
    return Firings.of(times.reshape(-1), packed=scene.device.is_cpu and pattern.origins is None)


def _share_origins(pattern: Pattern) -> bool:
    """Whether enough rays leave from one origin to be cast in packets."""
    return pattern.origins is None or _are_shared(same_rows(pattern.origins.reshape(-1, 3)))


def _are_shared(group: NDArray[np.int32]) -> bool:
    """Whether groups, (n,) the one of each ray, have enough rays on the average."""
    return FEWEST * (group.max(initial=-1) + 1) <= len(group)


def _upload_rays(pattern: Pattern, scene: Stage) -> Rays:
    """The rays of a pattern on the device."""
    origins = np.zeros((1, 3)) if pattern.origins is None else pattern.origins
    return _packed(pattern, rays_in_frame(pattern.directions, origins, np.eye(4), scene.device), scene)


def _packed(pattern: Pattern, rays: Rays, scene: Stage) -> Rays:
    """The rays of a pattern as they are cast together: on CUDA in warps, on the CPU in packets, or in bundles where
    enough run in one direction."""
    if scene.device.is_cuda:
        return replace(rays, packets=_warps(pattern, scene.device))
    if _share_origins(pattern):
        return replace(rays, packets=pattern.packets or _packets(pattern, rays))
    if pattern.later is not None:
        return rays
    group = same_rows(rays.directions.numpy())
    return replace(rays, packets=sort_into_bundles(rays.origins.numpy(), group)) if _are_shared(group) else rays


def _warps(pattern: Pattern, device: wp.Device) -> Warps | None:
    """The rays of a pattern in warps; None for those of several origins, or that are others in each reading."""
    if pattern.origins is not None or pattern.later is not None:
        return None
    weights = EVEN if pattern.ring is None else LEVEL
    return sort_into_warps(pattern.directions.reshape(-1, 3), device, weights)


def _packets(pattern: Pattern, rays: Rays) -> Packets:
    """The rays of a pattern in packets: sorted once, or in order where they are others in each reading."""
    group = groups_of(rays)
    return cached_packets(rays.directions, group) if pattern.later is None else pack_in_order(rays.directions, group)


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
