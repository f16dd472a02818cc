"""Sub-rays that are cast in place of each ray of a sensor."""

from collections.abc import Callable
from dataclasses import replace
from operator import is_

import warp as wp

from rigcast.kernels.effects.lidars.beams import repeated
from rigcast.kernels.packing.firings import groups_of, repeat_firing
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.rays.coherent import Packets
from rigcast.sensors.scene.cache.packets import cached_packets


class SubRays:
    """A cache of `times` sub-rays per ray; `directions` computes their unit directions, (n times,) vec3d.

    They are kept, with their packets, while the rays keep their directions and firings.
    """

    def __init__(self, times: int, directions: Callable[[Rays], wp.array]) -> None:
        self._times, self._directions = times, directions
        # the sub-rays, and the directions and firings that they were made for:
        self._made: Rays | None = None
        self._of: tuple[wp.array | None, ...] = ()

    def of(self, rays: Rays) -> Rays:
        """The sub-rays of these rays at their pose; packed if the rays are."""
        given = rays.directions, rays.firing
        if self._made is None or not all(map(is_, given, self._of)):
            made = replace(
                rays,
                directions=self._directions(rays),
                origins=repeated(rays.origins, self._times),
                firing=repeat_firing(rays.firing, self._times),
            )
            packets = cached_packets(made.directions, groups_of(made)) if isinstance(rays.packets, Packets) else None
            self._made, self._of = replace(made, packets=packets), given
        kept = self._made
        return replace(rays, directions=kept.directions, origins=kept.origins, firing=kept.firing, packets=kept.packets)
