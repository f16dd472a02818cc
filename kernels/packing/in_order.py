"""Packets of consecutive rays, for rays that change with each reading.

A steered beam moves little from one ray to the next, so consecutive rays are neighbours. So are rays towards the hits
of neighbouring rays. Packing them takes a fraction of the time of their cast, where sorting would take longer than
casting them singly.
"""

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.packets.packet import (
    LANES,
    PACKETS,
    TILE,
    Packet,
    Tile,
    double_lanes,
    int_lanes,
    lanes,
    max_of_lanes,
)
from rigcast.kernels.rays.coherent import Packets

from .sorting import SLACK, SPARSE, WIDEST

_TILES_PER_SLICE = 256
"""Minimum number of tiles for another thread: fewer are packed in less time than a thread takes to begin."""
_LINES = 4
"""Most lines from which a packet takes rays, equally many from each."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.struct
class Packing:
    """Rays in the order in which they are packed, and the resulting tiles.

    A struct, because Warp compiles a kernel twice if arrays are its arguments.
    """

    directions: wp.array[wp.vec3d]
    order: wp.array[int]
    starts: wp.array[int]  # (tiles + 1,) index in `order` of each tile's first ray, and the end of the last
    # out:
    tiles: wp.array[Tile]
    packets: wp.array[Packet]
    is_dense: wp.array[wp.bool]


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native("""
    auto& packet = these.packets.data[at];
    for (int i = 0; i < 16; ++i) {
        const int number = these.order.data[begin + i < end ? begin + i : end - 1];
        const wp::vec3d& d = these.directions.data[number];
        packet.ray[i] = begin + i < end ? number : -1;
        packet.x[i] = d[0];
        packet.y[i] = d[1];
        packet.z[i] = d[2];
    }
""")
def gather(these: Packing, at: int, begin: int, end: int):  # type: ignore[no-untyped-def]
    """Write numbers and directions of rays begin to end - 1 to packet `at`; p, q and length are not set.

    If there are fewer than LANES, the last ray's direction is repeated with number -1. Native: Warp checks every index
    for < 0.
    """


@wp.func
def are_in_row(numbers: int_lanes) -> bool:
    """Whether the rays of a packet have consecutive numbers."""
    apart = int(0)
    for i in range(LANES):
        apart = apart | (numbers[i] - numbers[0] - i)
    return apart == 0


@wp.func
def sum_of(values: double_lanes) -> wp.float64:
    total = wp.float64(0.0)
    for i in range(LANES):
        total += values[i]
    return total


@wp.func
def tile_along(axis: wp.vec3d) -> Tile:
    """A tile without packets whose axis is a unit vector."""
    tile = Tile()
    tile.axis = axis
    aside = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    if wp.abs(axis[2]) > wp.float64(0.9):
        aside = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    tile.u = wp.normalize(wp.cross(aside, axis))
    tile.v = wp.cross(axis, tile.u)
    return tile


@wp.func
def project_packet(packets: wp.array[Packet], at: int, tile: Tile) -> int:
    """Write p, q and length of a packet's rays in a tile; return 0 if all are finite and close to its axis, else 1."""
    x = packets[at].x
    y = packets[at].y
    z = packets[at].z
    axis = tile.axis
    u = tile.u
    v = tile.v
    p = lanes()
    q = lanes()
    length = lanes()
    apart = int(0)
    for i in range(LANES):
        along = x[i] * axis[0] + y[i] * axis[1] + z[i] * axis[2]
        per_along = wp.float64(1.0) / along
        p[i] = float((x[i] * u[0] + y[i] * u[1] + z[i] * u[2]) * per_along)
        q[i] = float((x[i] * v[0] + y[i] * v[1] + z[i] * v[2]) * per_along)
        length[i] = float(per_along)
        apart = apart | wp.where(along > WIDEST, 0, 1)
    packets[at].p = p
    packets[at].q = q
    packets[at].length = length
    return apart


@wp.func
def gather_packets(these: Packing, t: int, begin: int, end: int) -> wp.vec3d:
    """Make the packets of tile t from rays begin to end - 1 in order; return the sum of their directions."""
    packets = these.packets
    sum_x = double_lanes()
    sum_y = double_lanes()
    sum_z = double_lanes()
    for k in range(PACKETS):
        at = t * PACKETS + k
        if begin + k * LANES >= end:
            packets[at] = Packet()
            packets[at].ray = int_lanes(-1)
        else:
            gather(these, at, begin + k * LANES, end)
            x = packets[at].x
            y = packets[at].y
            z = packets[at].z
            for i in range(LANES):
                sum_x[i] = sum_x[i] + x[i]
                sum_y[i] = sum_y[i] + y[i]
                sum_z[i] = sum_z[i] + z[i]
    return wp.vec3d(sum_of(sum_x), sum_of(sum_y), sum_of(sum_z))


@wp.func
def pack_tile(these: Packing, t: int) -> None:
    """Make tile t, and write whether it is dense: its rays are finite, near its axis, and enough for its size."""
    packets = these.packets
    begin = these.starts[t]
    end = these.starts[t + 1]
    tile = tile_along(wp.normalize(gather_packets(these, t, begin, end)))
    tile.ray = these.order[begin]
    tile.across = 1
    apart = int(0)
    area = float(0.0)
    for k in range(PACKETS):
        at = t * PACKETS + k
        tile.rows[k] = packets[at].ray[0]
        if tile.rows[k] < 0 or not are_in_row(packets[at].ray):
            tile.across = 0
        if begin + k * LANES < end:
            tile.packets = tile.packets | (1 << k)
            apart = apart | project_packet(packets, at, tile)
            p = packets[at].p
            q = packets[at].q
            p_low = -max_of_lanes(-p) - SLACK
            p_high = max_of_lanes(p) + SLACK
            q_low = -max_of_lanes(-q) - SLACK
            q_high = max_of_lanes(q) + SLACK
            area += (p_high - p_low) * (q_high - q_low)
            tile.p_low[k] = p_low
            tile.p_high[k] = p_high
            tile.q_low[k] = q_low
            tile.q_high[k] = q_high
    these.tiles[t] = tile
    these.is_dense[t] = apart == 0 and area < SPARSE * float(end - begin)


@wp.kernel
def pack_tiles(first: int, these: Packing) -> None:
    pack_tile(these, first + wp.tid())


def pack_in_order(
    directions: wp.array, group: npt.NDArray[np.int32] | None = None, order: npt.NDArray[np.int32] | None = None
) -> Packets:
    """Pack rays with unit directions (n,) vec3d in order; tiles hold rays of one group.

    Args:
        group: (n,) numbers of groups; None if there is one.
        order: (n,) numbers of all rays, consecutive ones being neighbours; None for their own order.
    """
    if group is None and order is None:
        packing = PackingInOrder(*by_number(directions.size))
    else:
        packing = PackingInOrder(
            *_by_group(np.arange(directions.size, dtype=np.int32) if order is None else order, group)
        )
    packing.begin(directions)
    launch_over_rays(pack_tiles, packing.tiles, [packing.these], [], "cpu", slice_size=_TILES_PER_SLICE)
    return packing.end()


class PackingInOrder:
    """Packs the rays of successive readings in one order, (n,). starts: (tiles + 1,), see Packing.

    Between `begin` and `end`, a kernel calls `pack_tile` with `these` for each of `tiles` tiles.
    """

    def __init__(self, order: wp.array, starts: wp.array) -> None:
        self.tiles = starts.size - 1
        self.these = these = Packing()
        these.order, these.starts = order, starts
        these.is_dense = wp.empty(self.tiles, dtype=wp.bool, device="cpu")
        self._is_dense, self._no_singles = these.is_dense.numpy(), wp.empty(0, dtype=int, device="cpu")

    def begin(self, directions: wp.array) -> None:
        """Allocate the tiles of rays with unit directions (n,) vec3d."""
        self.these.directions = directions
        self.these.tiles = wp.empty(self.tiles, dtype=Tile, device="cpu")
        self.these.packets = wp.empty(PACKETS * self.tiles, dtype=Packet, device="cpu")

    def end(self) -> Packets:
        """The dense tiles; the rays of the others become single rays."""
        these, is_dense = self.these, self._is_dense
        if is_dense.all():
            return Packets(these.tiles, these.packets, self._no_singles)
        alone = np.repeat(~is_dense, np.diff(these.starts.numpy()))
        return Packets(
            wp.array(these.tiles.numpy()[is_dense], dtype=Tile, device="cpu"),
            wp.array(these.packets.numpy()[np.repeat(is_dense, PACKETS)], dtype=Packet, device="cpu"),
            wp.array(these.order.numpy()[alone], dtype=int, device="cpu"),
        )


@lru_cache(maxsize=8)  # patterns of different sizes
def by_number(count: int, lines: int = 1) -> tuple[wp.array, wp.array]:
    """Order and starts (see Packing) of `count` rays in the order of their numbers.

    lines: number of lines that fire in turn, neighbours by number. With many lines, each packet of a tile takes only
    some: a packet of all lines has few rays of each and is long across the path.
    """
    number = np.arange(count, dtype=np.int32)
    some = number % lines * -(-lines // _LINES) // lines
    return _by_group(number[np.lexsort([some, number // TILE])], None)


def _by_group(order: npt.NDArray[np.int32], group: npt.NDArray[np.int32] | None) -> tuple[wp.array, wp.array]:
    """Order and starts of rays with this order (n,), sorted stably by group. group: (n,) per ray."""
    if group is not None:
        order = order[np.argsort(group[order], kind="stable")]
    starts = _starts(len(order), None if group is None else group[order])
    return wp.array(order, dtype=int, device="cpu"), wp.array(starts, dtype=int, device="cpu")


def _starts(count: int, group: npt.NDArray[np.integer] | None) -> npt.NDArray[np.int32]:
    """First index of each tile, for rays sorted by group, and the end of the last tile."""
    if group is None:
        return np.append(np.arange(0, count, TILE), count).astype(np.int32)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    size = np.diff(first, append=count)
    tiles = -(-size // TILE)
    within = np.arange(tiles.sum()) - np.repeat(np.cumsum(tiles) - tiles, tiles)
    return np.append(np.repeat(first, tiles) + TILE * within, count).astype(np.int32)
