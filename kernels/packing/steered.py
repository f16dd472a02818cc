"""Rays that are steered a little from where they were sorted into packets."""

from dataclasses import replace

import warp as wp

from rigcast.kernels.rays.arrays import Rays

from .firings import groups_of
from .in_order import pack_in_order
from .sorting import Packets
from .warps import Warps


def steered(rays: Rays, directions: wp.array, origins: wp.array | None = None) -> Rays:
    """The same rays with other unit directions, (W N,) vec3d, and from other origins if these are given.

    Those that were neighbours are taken to be neighbours still: they are packed as they follow each other in the rays'
    packets, of which there are none for directions that differ from world to world.
    """
    packets: Packets | Warps | None = rays.packets if isinstance(rays.packets, Warps) else None
    if isinstance(rays.packets, Packets) and rays.worlds == 1:
        packets = pack_in_order(directions, groups_of(rays), rays.packets.order)
    origins = rays.origins if origins is None else origins
    return replace(rays, directions=directions.reshape((rays.worlds, -1)), origins=origins, packets=packets)
