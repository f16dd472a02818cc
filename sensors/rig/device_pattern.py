"""The pattern of a sensor on a device: its rays, grouped for casts, and their further fields in frames."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.packing.bundling import sort_into_bundles
from rigcast.kernels.packing.firings import groups_of, same_rows
from rigcast.kernels.packing.in_order import pack_in_order
from rigcast.kernels.packing.warps import EVEN, LEVEL, sort_into_warps
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.rays.coherent import Packets, Warps
from rigcast.sensors.captured import is_captured
from rigcast.sensors.errors import InputError
from rigcast.sensors.scene.cache.packets import cached_packets
from rigcast.sensors.scene.rays.given import lend
from rigcast.sensors.scene.rays.placed import rays_in_frame
from rigcast.sensors.specs.pattern import Pattern
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .timing.motion import FEWEST, Firings, Track


@dataclass(frozen=True, eq=False)
class DevicePattern:
    """The rays of one reading of a sensor on a device.

    given: the same on the host. rays: as if all were fired at one time, in the sensor's frame. firings: of a sensor
    that moves during a reading, None of others. firing_times [s], ring, column: of `frame_shape`, None where the
    pattern has none.
    """

    spec: SensorSpec
    given: Pattern
    rays: Rays
    firings: Firings | None
    firing_times: wp.array | None
    ring: wp.array | None
    column: wp.array | None

    @staticmethod
    def of(spec: SensorSpec, pattern: Pattern, device: wp.Device) -> "DevicePattern":
        origins = np.zeros((1, 3)) if pattern.origins is None else pattern.origins
        return _uploaded(spec, pattern, rays_in_frame(pattern.directions, origins, np.eye(4), device))

    def at(self, time: float) -> "DevicePattern":
        """The pattern of the reading that begins at `time` [s], if each reading has another one."""
        device = self.rays.directions.device
        pattern = self.given.at(time, in_packets=device.is_cpu)
        if is_captured(device):
            what = "got a pattern that is another one in each reading while a CUDA graph is captured"
            raise InputError(f"sensor {self.spec.name!r}: {what}, expected one that stays")
        rays = replace(self.rays, directions=lend(pattern.directions, device), packets=None)
        if all(getattr(pattern, name) is getattr(self.given, name) for name in ("firing_times", "ring", "column")):
            return replace(self, given=pattern, rays=_packed(pattern, rays))
        return _uploaded(self.spec, pattern, rays)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the rays; see Pattern.shape."""
        return self.given.shape

    @cached_property
    def frame_shape(self) -> tuple[int, ...]:
        """Shape of a frame's fields: that of the rays, with a last axis for several returns."""
        returns = self.spec.returns_per_ray
        return self.shape if returns == 1 else (*self.shape, returns)

    def rays_along(self, track: Track) -> Rays:
        """The rays of a moving sensor, at its poses on this track at the times of its firings."""
        device = self.rays.directions.device
        return replace(
            self._rays_fired,
            position=wp.array(track.position, dtype=wp.vec3d, device=device),
            rotation=wp.array(track.rotation, dtype=wp.mat33d, device=device),
            span=wp.array(track.span, dtype=int, device=device),
            fraction=wp.array(track.fraction, dtype=wp.float64, device=device),
        )

    @cached_property
    def _rays_fired(self) -> Rays:
        """The rays of a moving sensor, each with its firing."""
        assert self.firings is not None
        device = self.rays.directions.device
        rays = replace(self.rays, firing=wp.array(self.firings.of_ray, dtype=int, device=device))
        if device.is_cuda:
            return rays
        return replace(rays, packets=_packets(self.given, rays) if self.given.origins is None else None)


def _uploaded(spec: SensorSpec, pattern: Pattern, rays: Rays) -> DevicePattern:
    """A pattern whose rays are on the device, but not yet packed."""
    device = rays.directions.device
    return DevicePattern(
        spec,
        pattern,
        _packed(pattern, rays),
        _firings(spec, pattern, device),
        _upload(pattern.firing_times, wp.float64, spec, device),
        _upload(pattern.ring, wp.int32, spec, device),
        _upload(pattern.column, wp.int32, spec, device),
    )


def _firings(spec: SensorSpec, pattern: Pattern, device: wp.Device) -> Firings | None:
    if not spec.moves:
        return None
    times = np.zeros(pattern.shape) if pattern.firing_times is None else pattern.firing_times
    return Firings.of(times.reshape(-1), packed=device.is_cpu and pattern.origins is None)


def _packed(pattern: Pattern, rays: Rays) -> Rays:
    """The rays of a pattern grouped for casts: on CUDA in warps; on the CPU in packets, or in bundles if
    enough run in one direction."""
    device = rays.directions.device
    if device.is_cuda:
        return replace(rays, packets=_warps(pattern, device))
    if _share_origins(pattern):
        return replace(rays, packets=pattern.packets or _packets(pattern, rays))
    if pattern.later is not None:
        return rays
    group = same_rows(rays.directions.numpy())
    return replace(rays, packets=sort_into_bundles(rays.origins.numpy(), group)) if _are_shared(group) else rays


def _share_origins(pattern: Pattern) -> bool:
    """Whether enough rays share an origin to be cast in packets."""
    return pattern.origins is None or _are_shared(same_rows(pattern.origins.reshape(-1, 3)))


def _are_shared(group: NDArray[np.int32]) -> bool:
    """Whether groups have enough rays on average. group: (n,) number of each ray's group."""
    return FEWEST * (group.max(initial=-1) + 1) <= len(group)


def _warps(pattern: Pattern, device: wp.Device) -> Warps | None:
    """The rays of a pattern in warps; None if they have several origins or change with each reading."""
    if pattern.origins is not None or pattern.later is not None:
        return None
    weights = EVEN if pattern.ring is None else LEVEL
    return sort_into_warps(pattern.directions.reshape(-1, 3), device, weights)


def _packets(pattern: Pattern, rays: Rays) -> Packets:
    """The rays of a pattern in packets: sorted once, or in order if they change with each reading."""
    group = groups_of(rays)
    return cached_packets(rays.directions, group) if pattern.later is None else pack_in_order(rays.directions, group)


def _upload(values: NDArray[np.generic] | None, dtype: type, spec: SensorSpec, device: wp.Device) -> wp.array | None:
    """Per-ray values on the device, repeated for each return; None for None."""
    if values is None:
        return None
    returns = spec.returns_per_ray
    every = values if returns == 1 else np.repeat(values[..., None], returns, axis=-1)
    return wp.array(every, dtype=dtype, device=device)
