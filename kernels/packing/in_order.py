"""Rays in packets as they follow each other, for rays that are other ones in each reading.

A beam that is steered moves on but little from one ray to the next, so rays that follow each other are neighbours; so
are rays to what neighbouring rays have hit. They are packed several times sooner than they are cast, where sorting them
would take longer than casting them one by one.
"""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launch import launch_over_rays
from rigcast.kernels.packets.packet import LANES, PACKETS, Packet, Tile, double_lanes, int_lanes, lanes
from rigcast.kernels.vectors import larger, smaller

from .sorting import SLACK, SPARSE, TILE, WIDEST, Packets

_TILES_PER_SLICE = 256
"""Fewer are packed sooner than another thread begins."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.func
def sum_of(directions: wp.array[wp.vec3d], order: wp.array[int], begin: int, end: int) -> wp.vec3d:
    total = wp.vec3d()
    for k in range(begin, end):
        total += directions[order[k]]
    return total


@wp.func
def least_along(directions: wp.array[wp.vec3d], order: wp.array[int], begin: int, end: int, axis: wp.vec3d) -> float:
    """The least cosine between any of these rays and the axis; below 0 where a ray is not finite."""
    least = wp.float64(1.0)
    for k in range(begin, end):
        along = wp.dot(directions[order[k]], axis)
        least = wp.where(along >= least, least, wp.where(wp.isfinite(along), along, wp.float64(-1.0)))
    return float(least)


@wp.func
def packet_in_order(directions: wp.array[wp.vec3d], order: wp.array[int], begin: int, end: int, tile: Tile) -> Packet:
    """Rays begin to end - 1, fewer than LANES of which repeat the last one, as no ray."""
    ray = int_lanes()
    x = double_lanes()
    y = double_lanes()
    z = double_lanes()
    p = lanes()
    q = lanes()
    length = lanes()
    for i in range(LANES):
        at = order[wp.min(begin + i, end - 1)]
        d = directions[at]
        per_along = wp.float64(1.0) / wp.dot(d, tile.axis)
        ray[i] = wp.where(begin + i < end, at, -1)
        x[i] = d[0]
        y[i] = d[1]
        z[i] = d[2]
        p[i] = float(wp.dot(d, tile.u) * per_along)
        q[i] = float(wp.dot(d, tile.v) * per_along)
        length[i] = float(per_along)
    packet = Packet()
    packet.ray = ray
    packet.x = x
    packet.y = y
    packet.z = z
    packet.p = p
    packet.q = q
    packet.length = length
    return packet


@wp.kernel
def pack_tiles(
    first: int,
    directions: wp.array[wp.vec3d],
    order: wp.array[int],
    starts: wp.array[int],  # of the tiles, and the end of the last
    # out:
    tiles: wp.array[Tile],
    packets: wp.array[Packet],
    is_dense: wp.array[wp.bool],
) -> None:
    """One tile per thread; one whose rays are far apart is left as it is, not dense."""
    t = first + wp.tid()
    begin = starts[t]
    end = starts[t + 1]
    tile = Tile()
    tile.ray = order[begin]
    tile.axis = wp.normalize(sum_of(directions, order, begin, end))
    aside = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    if wp.abs(tile.axis[2]) > wp.float64(0.9):
        aside = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    tile.u = wp.normalize(wp.cross(aside, tile.axis))
    tile.v = wp.cross(tile.axis, tile.u)
    is_dense[t] = False
    if least_along(directions, order, begin, end, tile.axis) <= WIDEST:
        return
    area = float(0.0)
    for k in range(PACKETS):
        at = t * PACKETS + k
        if begin + k * LANES >= end:
            packets[at] = Packet()
            packets[at].ray = int_lanes(-1)
        else:
            packet = packet_in_order(directions, order, begin + k * LANES, end, tile)
            packets[at] = packet
            tile.packets = tile.packets | (1 << k)
            p_low = float(packet.p[0])
            p_high = float(packet.p[0])
            q_low = float(packet.q[0])
            q_high = float(packet.q[0])
            for i in range(LANES):
                p_low = smaller(p_low, packet.p[i])
                p_high = larger(p_high, packet.p[i])
                q_low = smaller(q_low, packet.q[i])
                q_high = larger(q_high, packet.q[i])
            tile.p_low[k] = p_low - SLACK
            tile.p_high[k] = p_high + SLACK
            tile.q_low[k] = q_low - SLACK
            tile.q_high[k] = q_high + SLACK
            area += (p_high - p_low) * (q_high - q_low)
    tiles[t] = tile
    is_dense[t] = area < SPARSE * float(end - begin)


def pack_in_order(
    directions: wp.array, group: npt.NDArray[np.int32] | None = None, order: npt.NDArray[np.int32] | None = None
) -> Packets:
    """Pack rays with unit directions (n,) vec3d; those of a tile belong to one group, (n,), where there are several.

    order: all rays, (n,), as they follow each other; None where they do so by number.
    """
    count = directions.size
    if order is None:
        order = np.arange(count, dtype=np.int32)
    if group is not None:
        order = order[np.argsort(group[order], kind="stable")]
    starts = _starts(count, None if group is None else group[order])
    tiles = wp.zeros(len(starts) - 1, dtype=Tile, device="cpu")
    packets = wp.empty(PACKETS * tiles.size, dtype=Packet, device="cpu")
    dense = wp.empty(tiles.size, dtype=wp.bool, device="cpu")
    inputs = [directions, wp.array(order, dtype=int, device="cpu"), wp.array(starts, dtype=int, device="cpu")]
    launch_over_rays(pack_tiles, tiles.size, inputs, [tiles, packets, dense], "cpu", slice_size=_TILES_PER_SLICE)
    is_dense = dense.numpy()
    if is_dense.all():
        return Packets(tiles, packets, wp.empty(0, dtype=int, device="cpu"))
    return Packets(
        wp.array(tiles.numpy()[is_dense], dtype=Tile, device="cpu"),
        wp.array(packets.numpy()[np.repeat(is_dense, PACKETS)], dtype=Packet, device="cpu"),
        wp.array(order[np.repeat(~is_dense, np.diff(starts))], dtype=int, device="cpu"),
    )


def _starts(count: int, group: npt.NDArray[np.integer] | None) -> npt.NDArray[np.int32]:
    """Where each tile starts, of rays whose groups follow each other, and the end of the last."""
    if group is None:
        return np.append(np.arange(0, count, TILE), count).astype(np.int32)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    size = np.diff(first, append=count)
    tiles = -(-size // TILE)
    within = np.arange(tiles.sum()) - np.repeat(np.cumsum(tiles) - tiles, tiles)
    return np.append(np.repeat(first, tiles) + TILE * within, count).astype(np.int32)
