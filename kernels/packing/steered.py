"""Rays whose directions differ a little from those that were sorted into packets."""

from dataclasses import replace

import warp as wp

from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.rays.coherent import Packets, Warps

from .firings import groups_of
from .in_order import pack_in_order


def steered(rays: Rays, directions: wp.array, origins: wp.array | None = None) -> Rays:
    """The rays with other unit directions, (W N,) vec3d, and other origins if given.

    Neighbours are assumed to stay neighbours: on CUDA rays keep their warps, on the CPU they are packed in the order of
    their packets. With several worlds on the CPU, where directions differ between worlds, the rays are cast singly.
    """
    origins = rays.origins if origins is None else origins
    turned = replace(rays, directions=directions.reshape((rays.worlds, -1)), origins=origins, packets=None)
    if isinstance(rays.packets, Packets) and rays.worlds == 1:
        return replace(turned, packets=pack_in_order(directions, groups_of(turned), rays.packets.order))
    return replace(turned, packets=rays.packets) if isinstance(rays.packets, Warps) else turned
