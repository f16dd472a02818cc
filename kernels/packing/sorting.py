"""Sorting of rays from one origin into packets of neighbours, for rigcast.kernels.packets.

There are three arrangements; the one whose packets are expected to meet the fewest boxes is used.

- *Blocks*: the rays are halved along the axis on which their directions differ most, until a tile is left. The tile is
  halved in the same way into its packets.
- *Squares*, for an image stored row by row: a tile is 8 rows of 16 pixels, a packet a square of 4 x 4. Rows of pixels
  are curved in direction space, so blocks would have ragged edges.
- *Runs*: a packet is LANES consecutive rays of the pattern, a tile PACKETS neighbouring runs. For a lidar whose rows
  are far apart, a run along a row is wide but has no height: it passes between most objects smaller than the gap
  between rows, and a block would meet all of them.

Rays without near neighbours are cast singly.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.packets.packet import LANES, PACKETS, TILE, Packet, Tile
from rigcast.kernels.rays.coherent import Packets
from rigcast.kernels.trees.nodes import struct_zeros

SQUARE = 4
"""Side of an image's packet [pixels]."""
TILE_ROWS, TILE_COLUMNS = 2 * SQUARE, 4 * SQUARE
CHUNK = 32 * TILE
WIDEST = np.cos(np.radians(45.0))
"""Cosine of 45 degrees, the largest angle between a ray and its tile's axis."""
SPARSE = 0.005
"""Area in (p, q) per ray above which rays are faster when cast singly."""
WIDEST_RUN = np.cos(np.radians(10.0))
"""Cosine of 10 degrees, the largest angle between a ray and its run's axis; excludes runs that wrap to the next row."""
SEEN = 0.01
"""Assumed size, in p and q, of the boxes that packets meet; used to compare arrangements."""
SLACK = 1e-6
"""Widening of the ranges of p and q: more than float32 rounding of these, and of a tile's side planes."""

Indices = npt.NDArray[np.int64]
Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Arrangement:
    """Rays in tiles (tiles, PACKETS, LANES), and single rays.

    A negative entry ~k in tiles is an empty lane with the direction of ray k. bases, places: see `_places`. low, high:
    (tiles, PACKETS, 2) ranges of p and q.
    """

    tiles: Indices
    singles: Indices
    bases: Doubles
    places: Doubles
    low: Doubles
    high: Doubles

    @staticmethod
    def of(tiles: Indices, singles: Indices, directions: Doubles) -> "_Arrangement":
        """The arrangement of these tiles; the rays of sparse tiles become single rays."""
        bases, places = _places(tiles, directions)
        low, high = places[..., :2].min(axis=2) - SLACK, places[..., :2].max(axis=2) + SLACK
        is_dense = np.prod(high - low, axis=-1).sum(axis=1) < SPARSE * (tiles >= 0).sum(axis=(1, 2))
        sparse = tiles[~is_dense]
        kept = (a[is_dense] for a in (bases, places, low, high))
        return _Arrangement(tiles[is_dense], np.concatenate([singles, sparse[sparse >= 0]]), *kept)

    @property
    def cost(self) -> float:
        """Expected number of boxes of size SEEN that the packets and single rays meet, up to a factor."""
        packets = np.prod(self.high - self.low + SEEN, axis=-1)[(self.tiles >= 0).any(axis=2)]
        return float(packets.sum() + len(self.singles) * SEEN**2)


def sort_into_packets(directions: Doubles, group: npt.NDArray[np.int32] | None = None) -> Packets:
    """Sort rays with unit directions (n, 3) into packets. group: (n,), tiles hold rays of one group; None for one."""
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
    """Whole tiles of an image, and the rays at its edges in blocks; [] if it is no image or smaller than a tile."""
    columns = _columns_of(directions)
    if columns < TILE_COLUMNS or len(directions) < TILE_ROWS * columns:
        return []
    down, across = len(directions) // columns // TILE_ROWS, columns // TILE_COLUMNS
    numbers = np.arange(len(directions)).reshape(-1, columns)[: down * TILE_ROWS, : across * TILE_COLUMNS]
    squares = numbers.reshape(down, TILE_ROWS // SQUARE, SQUARE, across, TILE_COLUMNS // SQUARE, SQUARE)
    return [_with_rest(squares.transpose(0, 3, 1, 4, 2, 5).reshape(-1, PACKETS, LANES), directions)]


def _columns_of(directions: Doubles) -> int:
    """Length of an image's rows, found where the angle to the first ray begins to fall; 0 if it is no image."""
    along = directions @ directions[0] if len(directions) else np.empty(0)
    nearer = np.flatnonzero(np.diff(along) > 0)
    columns = int(nearer[0]) + 1 if len(nearer) else 0
    return columns if columns and len(directions) % columns == 0 else 0


def _least_cost_of_runs(directions: Doubles) -> float:
    """Lower bound on the cost of runs: their cost as straight lines."""
    count = len(directions) // LANES * LANES
    length = np.linalg.norm(directions[LANES - 1 : count : LANES] - directions[:count:LANES], axis=1)
    return float((length + SEEN).sum() * SEEN)


def _in_runs(directions: Doubles) -> _Arrangement:
    """Narrow runs, and all other rays in blocks."""
    runs = np.arange(len(directions) // LANES * LANES).reshape(-1, LANES)
    middle = directions[runs].mean(axis=1)
    runs = runs[_along(directions[runs], middle) > WIDEST_RUN]
    return _with_rest(_tiles_of_runs(runs, directions), directions)


def _with_rest(tiles: Indices, directions: Doubles) -> _Arrangement:
    """The narrow ones of these tiles, and all other rays in blocks."""
    tiles = tiles[_is_narrow(directions[_or_near(tiles)].reshape(-1, TILE, 3))]
    is_left = np.ones(len(directions), bool)
    is_left[tiles[tiles >= 0]] = False
    rest = np.flatnonzero(is_left)
    blocks, singles = _tiles_of(directions[rest])
    blocks = halved_to(np.where(blocks >= 0, rest[blocks], ~rest[~blocks]), directions, LANES)
    tiles = np.concatenate([tiles, blocks.reshape(-1, PACKETS, LANES)])
    return _Arrangement.of(tiles, rest[singles], directions)


def _tiles_of_runs(runs: Indices, directions: Doubles) -> Indices:
    """Tiles (tiles, PACKETS, LANES) of neighbouring runs (m, LANES); a tile that is not full is padded with ~rays."""
    if len(runs) == 0:
        return np.empty((0, PACKETS, LANES), np.int64)
    parts = in_parts(np.arange(len(runs)), directions[runs].mean(axis=1), PACKETS)
    filled = [np.concatenate([runs[part], ~np.resize(runs[part], (PACKETS - len(part), LANES))]) for part in parts]
    return np.stack(filled)


def _tiles_of_groups(directions: Doubles, group: npt.NDArray[np.int32] | None) -> tuple[Indices, Indices]:
    """The tiles and single rays of `_tiles_of`, with every tile's rays from one group."""
    if group is None:
        return _tiles_of(directions)
    parts = [(rays, *_tiles_of(directions[rays])) for rays in members_of_groups(group)]
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
    """Reorder tiles (tiles, PACKETS, LANES) from packets to rows of LANES rays, `across` packets being side by side."""
    packets = tiles.reshape(-1, PACKETS // across, across, across, LANES // across)
    return packets.swapaxes(2, 3).reshape(-1, PACKETS, LANES)


def _packet_structs(tiles: Indices, places: Doubles, directions: Doubles) -> npt.NDArray[np.void]:
    structs = struct_zeros(Packet, len(tiles) * PACKETS)
    values = (np.maximum(tiles, -1), *np.moveaxis(directions[_or_near(tiles)], -1, 0), *np.moveaxis(places, -1, 0))
    for name, value in zip(("ray", "x", "y", "z", "p", "q", "length"), values, strict=True):
        structs[name] = value.reshape(-1, LANES)
    return structs


def _or_near(rays: Indices) -> Indices:
    """The rays, with ~k replaced by k."""
    return np.where(rays >= 0, rays, ~rays)


def _places(tiles: Indices, directions: Doubles) -> tuple[Doubles, Doubles]:
    """The axis, u, v of each tile (tiles, 3, 3), and p, q and length of each ray (tiles, PACKETS, LANES, 3)."""
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
    """Rays in tiles (tiles, TILE), and single rays; a negative ~k is an empty lane with the direction of ray k."""
    chunks, others = in_chunks(np.arange(len(directions)), directions, CHUNK)
    candidates = halved_to(chunks, directions, TILE)
    is_narrow = _is_narrow(directions[candidates])
    tiles, singles = [*candidates[is_narrow]], []
    for rays in [*candidates[~is_narrow], *others]:
        more, alone = _narrow_tiles(rays, directions)
        tiles += more
        singles += alone
    return np.array(tiles, np.int64).reshape(-1, TILE), np.concatenate([np.empty(0, np.int64), *singles])


def _narrow_tiles(rays: Indices, directions: Doubles) -> tuple[list[Indices], list[Indices]]:
    """Tiles, padded with ~rays, and lists of single rays."""
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
    """Whether all n directions (..., n, 3) are within 45 degrees of their mean; result (...)."""
    return _along(d, d.mean(axis=-2)) > WIDEST


def _along(d: Doubles, axis: Doubles) -> Doubles:
    """The least cosine (...) between unit directions (..., n, 3) and an axis (..., 3) of any length."""
    return np.einsum("...nk,...k->...n", d, axis).min(axis=-1, initial=1.0) / np.linalg.norm(axis, axis=-1)


def members_of_groups(group: npt.NDArray[np.int32]) -> list[Indices]:
    """The numbers of the rays of each group. group: (n,) of each ray."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)


def in_chunks(rays: Indices, directions: Doubles, size: int) -> tuple[Indices, list[Indices]]:
    """Split rays into chunks of neighbours: those of this size (m, size), and smaller ones."""
    chunks = in_parts(rays, directions, size) if len(rays) else []
    whole = np.array([chunk for chunk in chunks if len(chunk) == size], np.int64).reshape(-1, size)
    return whole, [chunk for chunk in chunks if len(chunk) != size]


def in_parts(rays: Indices, directions: Doubles, size: int) -> list[Indices]:
    """Split rays into parts of neighbours of this size; one part may be smaller."""
    if len(rays) <= size:
        return [rays]
    return [part for half in _halves(rays, directions, size) for part in in_parts(half, directions, size)]


def _halves(rays: Indices, directions: Doubles, multiple: int) -> tuple[Indices, Indices]:
    """Split rays in two along the widest axis; the size of the first part is a multiple of `multiple`."""
    xyz = np.ascontiguousarray(directions[rays].T)
    count = -(-len(rays) // (2 * multiple)) * multiple
    order = np.argpartition(xyz[np.argmax(np.ptp(xyz, axis=1))], count - 1)
    return rays[order[:count]], rays[order[count:]]


def halved_to(groups: Indices, directions: Doubles, size: int) -> Indices:
    """Rays (m, size): every row of groups (n, k) is halved repeatedly, k being `size` times a power of two."""
    directions = directions[_or_near(groups)]
    xyz = np.ascontiguousarray(np.moveaxis(directions, -1, 0), np.float32)
    while groups.shape[1] > size:
        half = groups.shape[1] // 2
        widest = np.argmax(np.ptp(xyz, axis=2), axis=0)
        order = np.argpartition(xyz[widest, np.arange(len(groups))], half - 1, axis=1)
        groups = np.take_along_axis(groups, order, axis=1).reshape(-1, half)
        xyz = np.take_along_axis(xyz, order[None], axis=2).reshape(3, -1, half)
    return groups
