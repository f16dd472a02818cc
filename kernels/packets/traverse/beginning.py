"""Initialisation of packets when they meet their first shape."""

import warp as wp

from rigcast.kernels.hits.hit import NO_SHAPE
from rigcast.kernels.inline import inlined
from rigcast.kernels.packets.packet import LANES, PacketHits, TileRays, double_lanes
from rigcast.kernels.vectors import lowest_bit


@inlined
def clear_packet(rays: wp.array[TileRays], k: int) -> None:
    """Clear the hits of packet k and compute its directions in the world."""
    rotation = rays[0].rotation
    slot = rays[0].first_slot + k
    packet = rays[0].packets[rays[0].first_packet + k]
    numbers = packet.ray
    x = packet.x
    y = packet.y
    z = packet.z
    world_x = double_lanes()
    world_y = double_lanes()
    world_z = double_lanes()
    hits = PacketHits()
    for i in range(LANES):
        d = rotation * wp.vec3d(x[i], y[i], z[i])
        world_x[i] = d[0]
        world_y[i] = d[1]
        world_z[i] = d[2]
        hits.near[i] = wp.inf
        hits.far[i] = wp.where(numbers[i] >= 0, wp.inf, -wp.inf)  # -inf: a lane without a ray enters no box
        hits.shape[i] = NO_SHAPE
    rays[0].best[slot] = hits
    rays[0].directions[slot].x = world_x
    rays[0].directions[slot].y = world_y
    rays[0].directions[slot].z = world_z


@wp.func
def begin_packets(rays: wp.array[TileRays], which: int) -> None:
    """Initialise the packets of mask `which`, which meet their first shape."""
    rays[0].met = rays[0].met | which
    todo = int(which)
    while todo != 0:
        clear_packet(rays, lowest_bit(todo))
        todo = todo & (todo - 1)
