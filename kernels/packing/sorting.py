"""Sorting rays from one origin into packets of neighbours, as rigcast.kernels.packets casts them.

There are three ways, and the one is taken whose packets are expected to meet least. *Blocks*: the rays are halved,
across the axis on which their directions differ most, until a tile of them is left, and the tile is halved in the same
way into its packets. *Squares*: of an image, whose rows follow each other in the pattern, a tile is 8 rows of 16
pixels, a packet a square of 4 x 4. Seen from the camera rows are curved, so that blocks have ragged edges. *Runs*: a
packet is LANES rays that follow each other in the pattern, a tile PACKETS neighbouring runs. A run along the row of a
lidar whose rows are far apart is wide but has no height, and so lies between most of what is smaller than the gap
between rows; a block would meet all of it.

Rays that have no near neighbours go alone.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.packets.packet import LANES, PACKETS, TILE, Packet, Tile
from rigcast.kernels.rays.coherent import Packets
from rigcast.kernels.trees.nodes import struct_zeros

SQUARE = 4
"""Pixels of an image along each side of a packet."""
TILE_ROWS, TILE_COLUMNS = 2 * SQUARE, 4 * SQUARE
CHUNK = 32 * TILE
WIDEST = np.cos(np.radians(45.0))
"""No ray of a tile is farther than 45 degrees from its axis."""
SPARSE = 0.005
"""Rays that take up more than this of p q each are faster alone."""
WIDEST_RUN = np.cos(np.radians(10.0))
"""No ray of a run is farther than 10 degrees from its axis: those that go on in the next row of an image are."""
SEEN = 0.01
"""How large, in p and q, the boxes are that packets are held against, for the choice between blocks and runs."""
SLACK = 1e-6
"""By how much ranges of p and q are widened: more than float32 rounds them, and the planes that bound a tile."""

Indices = npt.NDArray[np.int64]
Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Arrangement:
    """Rays in tiles (tiles, PACKETS, LANES), a negative ~k for no ray where k is, and those that go alone.

    bases, places: as of `_places`. low, high: (tiles, PACKETS, 2) ranges of p and q.
    """

    tiles: Indices
    singles: Indices
    bases: Doubles
    places: Doubles
    low: Doubles
    high: Doubles

    @staticmethod
    def of(tiles: Indices, singles: Indices, directions: Doubles) -> "_Arrangement":
        """Of tiles as they are, but for those whose rays are far apart: they go alone."""
        bases, places = _places(tiles, directions)
        low, high = places[..., :2].min(axis=2) - SLACK, places[..., :2].max(axis=2) + SLACK
        is_dense = np.prod(high - low, axis=-1).sum(axis=1) < SPARSE * (tiles >= 0).sum(axis=(1, 2))
        sparse = tiles[~is_dense]
        kept = (a[is_dense] for a in (bases, places, low, high))
        return _Arrangement(tiles[is_dense], np.concatenate([singles, sparse[sparse >= 0]]), *kept)

    @property
    def cost(self) -> float:
        """The boxes of size SEEN that its packets and single rays are expected to meet, up to a factor."""
        packets = np.prod(self.high - self.low + SEEN, axis=-1)[(self.tiles >= 0).any(axis=2)]
        return float(packets.sum() + len(self.singles) * SEEN**2)


def sort_into_packets(directions: Doubles, group: npt.NDArray[np.int32] | None = None) -> Packets:
    """Sort rays with unit directions (n, 3); those of a tile belong to one group, (n,), where there are several."""
    ways = [_in_blocks(directions, group)]
    if group is None:
        ways += _in_squares(directions)
        if _least_cost_of_runs(directions) < min(way.cost for way in ways):
            ways.append(_in_runs(directions))
    found = min(ways, key=lambda way: way.cost)
    return Packets(
        wp.array(_tile_structs(found.tiles, found.bases, found.low, found.high), dtype=Tile, device="cpu"),
        wp.array(_packet_structs(found.tiles, found.places, directions), dtype=Packet, device="cpu"),
        wp.array(found.singles, dtype=int, device="cpu"),
    )


def _in_blocks(directions: Doubles, group: npt.NDArray[np.int32] | None) -> _Arrangement:
    rays, singles = _tiles_of_groups(directions, group)
    return _Arrangement.of(halved_to(rays, directions, LANES).reshape(-1, PACKETS, LANES), singles, directions)


def _in_squares(directions: Doubles) -> list[_Arrangement]:
    """Whole tiles of an image, and the rays at its edges in blocks; nothing if it is none, or smaller than a tile."""
    columns = _columns_of(directions)
    if columns < TILE_COLUMNS or len(directions) < TILE_ROWS * columns:
        return []
    down, across = len(directions) // columns // TILE_ROWS, columns // TILE_COLUMNS
    numbers = np.arange(len(directions)).reshape(-1, columns)[: down * TILE_ROWS, : across * TILE_COLUMNS]
    squares = numbers.reshape(down, TILE_ROWS // SQUARE, SQUARE, across, TILE_COLUMNS // SQUARE, SQUARE)
    return [_with_rest(squares.transpose(0, 3, 1, 4, 2, 5).reshape(-1, PACKETS, LANES), directions)]


def _columns_of(directions: Doubles) -> int:
    """How long the rows of an image are, of which the next one begins nearer to its first ray; 0 if it is none."""
    along = directions @ directions[0] if len(directions) else np.empty(0)
    nearer = np.flatnonzero(np.diff(along) > 0)
    columns = int(nearer[0]) + 1 if len(nearer) else 0
    return columns if columns and len(directions) % columns == 0 else 0


def _least_cost_of_runs(directions: Doubles) -> float:
    """What the cost of runs would be if they were straight lines."""
    count = len(directions) // LANES * LANES
    length = np.linalg.norm(directions[LANES - 1 : count : LANES] - directions[:count:LANES], axis=1)
    return float((length + SEEN).sum() * SEEN)


def _in_runs(directions: Doubles) -> _Arrangement:
    """Runs that are narrow, and all other rays in blocks."""
    runs = np.arange(len(directions) // LANES * LANES).reshape(-1, LANES)
    middle = directions[runs].mean(axis=1)
    runs = runs[_along(directions[runs], middle) > WIDEST_RUN]
    return _with_rest(_tiles_of_runs(runs, directions), directions)


def _with_rest(tiles: Indices, directions: Doubles) -> _Arrangement:
    """Tiles that are narrow, and all other rays in blocks."""
    tiles = tiles[_is_narrow(directions[_or_near(tiles)].reshape(-1, TILE, 3))]
    is_left = np.ones(len(directions), bool)
    is_left[tiles[tiles >= 0]] = False
    rest = np.flatnonzero(is_left)
    blocks, singles = _tiles_of(directions[rest])
    blocks = halved_to(np.where(blocks >= 0, rest[blocks], ~rest[~blocks]), directions, LANES)
    tiles = np.concatenate([tiles, blocks.reshape(-1, PACKETS, LANES)])
    return _Arrangement.of(tiles, rest[singles], directions)


def _tiles_of_runs(runs: Indices, directions: Doubles) -> Indices:
    """(tiles, PACKETS, LANES): neighbouring runs (m, LANES); a tile that is not full is filled up with ~rays."""
    if len(runs) == 0:
        return np.empty((0, PACKETS, LANES), np.int64)
    parts = in_parts(np.arange(len(runs)), directions[runs].mean(axis=1), PACKETS)
    filled = [np.concatenate([runs[part], ~np.resize(runs[part], (PACKETS - len(part), LANES))]) for part in parts]
    return np.stack(filled)


def _tiles_of_groups(directions: Doubles, group: npt.NDArray[np.int32] | None) -> tuple[Indices, Indices]:
    """As `_tiles_of`, with the rays of a tile from one group."""
    if group is None:
        return _tiles_of(directions)
    order = np.argsort(group, kind="stable")
    parts = [
        (rays, *_tiles_of(directions[rays])) for rays in np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    ]
    return (
        np.concatenate([np.where(tiles >= 0, rays[tiles], ~rays[~tiles]) for rays, tiles, _ in parts]),
        np.concatenate([rays[singles] for rays, _, singles in parts]),
    )


def _tile_structs(tiles: Indices, bases: Doubles, low: Doubles, high: Doubles) -> npt.NDArray[np.void]:
    structs = struct_zeros(Tile, len(tiles))
    for k, name in enumerate(("axis", "u", "v")):
        structs[name] = bases[:, k]
    for k, name in enumerate("pq"):
        structs[f"{name}_low"], structs[f"{name}_high"] = low[..., k], high[..., k]
    structs["packets"] = ((tiles >= 0).any(axis=2) << np.arange(PACKETS)).sum(axis=1)
    structs["ray"] = _or_near(tiles[:, 0, 0])
    for across in (1, TILE_COLUMNS // SQUARE):
        rows = _rows_of(tiles, across)
        are_rows = (rows[..., 0] >= 0).all(axis=1) & (np.diff(rows) == 1).all(axis=(1, 2))
        structs["across"][are_rows], structs["rows"][are_rows] = across, rows[are_rows, :, 0]
    return structs


def _rows_of(tiles: Indices, across: int) -> Indices:
    """(tiles, PACKETS, LANES) row by row what (tiles, PACKETS, LANES) are packet by packet, so many side by side."""
    packets = tiles.reshape(-1, PACKETS // across, across, across, LANES // across)
    return packets.swapaxes(2, 3).reshape(-1, PACKETS, LANES)


def _packet_structs(tiles: Indices, places: Doubles, directions: Doubles) -> npt.NDArray[np.void]:
    structs = struct_zeros(Packet, len(tiles) * PACKETS)
    values = (np.maximum(tiles, -1), *np.moveaxis(directions[_or_near(tiles)], -1, 0), *np.moveaxis(places, -1, 0))
    for name, value in zip(("ray", "x", "y", "z", "p", "q", "length"), values, strict=True):
        structs[name] = value.reshape(-1, LANES)
    return structs


def _or_near(rays: Indices) -> Indices:
    """The rays, and k for each ~k."""
    return np.where(rays >= 0, rays, ~rays)


def _places(tiles: Indices, directions: Doubles) -> tuple[Doubles, Doubles]:
    """(tiles, 3, 3) axis, u, v of each tile, and (tiles, PACKETS, LANES, 3) p, q and length of each ray."""
    d = directions[_or_near(tiles)]
    axis = d.sum(axis=(1, 2))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    aside = np.where(np.abs(axis[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    u = np.cross(aside, axis)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(axis, u)
    along, p, q = (np.einsum("tplk,tk->tpl", d, e) for e in (axis, u, v))
    return np.stack([axis, u, v], axis=1), np.stack([p / along, q / along, 1.0 / along], axis=-1)


def _tiles_of(directions: Doubles) -> tuple[Indices, Indices]:
    """(tiles, TILE) rays, and the rays that go alone; a negative ~k stands for no ray, but is where k is."""
    chunks = in_parts(np.arange(len(directions)), directions, CHUNK) if len(directions) else []
    whole = np.array([c for c in chunks if len(c) == CHUNK], np.int64).reshape(-1, CHUNK)
    candidates = halved_to(whole, directions, TILE)
    is_narrow = _is_narrow(directions[candidates])
    tiles, singles = [*candidates[is_narrow]], []
    for rays in [*candidates[~is_narrow], *(c for c in chunks if len(c) != CHUNK)]:
        more, alone = _narrow_tiles(rays, directions)
        tiles += more
        singles += alone
    return np.array(tiles, np.int64).reshape(-1, TILE), np.concatenate([np.empty(0, np.int64), *singles])


def _narrow_tiles(rays: Indices, directions: Doubles) -> tuple[list[Indices], list[Indices]]:
    """Tiles, filled up with ~rays, and lists of rays that go alone."""
    if len(rays) <= TILE and _is_narrow(directions[rays]):
        return [np.concatenate([rays, ~np.resize(rays, TILE - len(rays))])], []
    if len(rays) <= LANES:
        return [], [rays]
    tiles, singles = [], []
    for half in _halves(rays, directions, TILE if len(rays) > TILE else LANES):
        more, alone = _narrow_tiles(half, directions)
        tiles += more
        singles += alone
    return tiles, singles


def _is_narrow(d: Doubles) -> npt.NDArray[np.bool_]:
    """(...) whether all of (..., n, 3) directions are close to their mean."""
    return _along(d, d.mean(axis=-2)) > WIDEST


def _along(d: Doubles, axis: Doubles) -> Doubles:
    """(...) the least cosine between (..., n, 3) unit directions and an axis (..., 3) of any length."""
    return np.einsum("...nk,...k->...n", d, axis).min(axis=-1, initial=1.0) / np.linalg.norm(axis, axis=-1)


def in_parts(rays: Indices, directions: Doubles, size: int) -> list[Indices]:
    """Parts of this size, but for one that is smaller."""
    if len(rays) <= size:
        return [rays]
    return [part for half in _halves(rays, directions, size) for part in in_parts(half, directions, size)]


def _halves(rays: Indices, directions: Doubles, multiple: int) -> tuple[Indices, Indices]:
    """Two parts, the first a multiple of a size, on both sides of the widest axis."""
    xyz = np.ascontiguousarray(directions[rays].T)
    count = -(-len(rays) // (2 * multiple)) * multiple
    order = np.argpartition(xyz[np.argmax(np.ptp(xyz, axis=1))], count - 1)
    return rays[order[:count]], rays[order[count:]]


def halved_to(groups: Indices, directions: Doubles, size: int) -> Indices:
    """(m, size) rays: every row of groups (n, k) halved again and again, k a power of two times the size."""
    directions = directions[_or_near(groups)]
    xyz = np.ascontiguousarray(np.moveaxis(directions, -1, 0), np.float32)
    while groups.shape[1] > size:
        half = groups.shape[1] // 2
        widest = np.argmax(np.ptp(xyz, axis=2), axis=0)
        order = np.argpartition(xyz[widest, np.arange(len(groups))], half - 1, axis=1)
        groups = np.take_along_axis(groups, order, axis=1).reshape(-1, half)
        xyz = np.take_along_axis(xyz, order[None], axis=2).reshape(3, -1, half)
    return groups
