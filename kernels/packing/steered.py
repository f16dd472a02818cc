"""Rays that are steered a little from where they were sorted into packets."""

from dataclasses import replace

import warp as wp

from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.rays.coherent import Packets, Warps

from .firings import groups_of
from .in_order import pack_in_order


def steered(rays: Rays, directions: wp.array, origins: wp.array | None = None) -> Rays:
    """The same rays with other unit directions, (W N,) vec3d, and from other origins if these are given.

    Those that were neighbours are taken to be neighbours still: on CUDA they stay in their warps, on the CPU they are
    packed as they follow each other in the rays' packets, of which there are none where directions differ from world to
    world.
    """
    origins = rays.origins if origins is None else origins
    turned = replace(rays, directions=directions.reshape((rays.worlds, -1)), origins=origins, packets=None)
    if isinstance(rays.packets, Packets) and rays.worlds == 1:
        return replace(turned, packets=pack_in_order(directions, groups_of(turned), rays.packets.order))
    return replace(turned, packets=rays.packets) if isinstance(rays.packets, Warps) else turned
