"""Sorting rays from one origin into packets of neighbours, as rigcast.kernels.packets casts them.

The rays are halved, across the axis on which their directions differ most, until a tile of them is left, and the tile
is halved in the same way into its packets. Rays that have no near neighbours go alone.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.tree import struct_zeros

from .packet import LANES, PACKETS, Packet, Tile

TILE = LANES * PACKETS
CHUNK = 32 * TILE
WIDEST = np.cos(np.radians(45.0))
"""No ray of a tile is farther than 45 degrees from its axis."""
SPARSE = 0.005
"""Rays that take up more than this of p q each are faster alone."""
SLACK = 1e-6
"""By how much ranges of p and q are widened: more than float32 rounds them."""

Indices = npt.NDArray[np.int64]
Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Packets:
    """Rays sorted into tiles of packets, on the CPU.

    singles: the rays that go alone. firing: (tiles,) int32, to which of several firings the rays of each tile belong.
    """

    tiles: wp.array
    packets: wp.array
    singles: wp.array
    firing: wp.array | None = None


def sort_into_packets(directions: Doubles, firing: npt.NDArray[np.int32] | None = None) -> Packets:
    """Sort rays with unit directions (n, 3); those of a tile belong to one firing, (n,), where there are several."""
    rays, of_tile, singles = _tiles_of_firings(directions, firing)
    tiles = _halved_to(rays, directions, LANES).reshape(-1, PACKETS, LANES)
    bases, places = _places(tiles, directions)
    low, high = places[..., :2].min(axis=2) - SLACK, places[..., :2].max(axis=2) + SLACK
    is_dense = np.prod(high - low, axis=-1).sum(axis=1) < SPARSE * (tiles >= 0).sum(axis=(1, 2))
    sparse = tiles[~is_dense]
    tiles, bases, places, low, high, of_tile = (a[is_dense] for a in (tiles, bases, places, low, high, of_tile))
    return Packets(
        wp.array(_tile_structs(tiles, bases, low, high), dtype=Tile, device="cpu"),
        wp.array(_packet_structs(tiles, places, directions), dtype=Packet, device="cpu"),
        wp.array(np.concatenate([singles, sparse[sparse >= 0]]), dtype=int, device="cpu"),
        None if firing is None else wp.array(of_tile, dtype=int, device="cpu"),
    )


def _tiles_of_firings(
    directions: Doubles, firing: npt.NDArray[np.int32] | None
) -> tuple[Indices, npt.NDArray[np.int32], Indices]:
    """(tiles, TILE) rays as of `_tiles_of`, (tiles,) their firings, and the rays that go alone."""
    if firing is None:
        tiles, singles = _tiles_of(directions)
        return tiles, np.zeros(len(tiles), np.int32), singles
    order = np.argsort(firing, kind="stable")
    parts = [
        (rays, *_tiles_of(directions[rays])) for rays in np.split(order, np.flatnonzero(np.diff(firing[order])) + 1)
    ]
    return (
        np.concatenate([np.where(tiles >= 0, rays[tiles], ~rays[~tiles]) for rays, tiles, _ in parts]),
        np.concatenate([np.repeat(firing[rays[:1]], len(tiles)) for rays, tiles, _ in parts]),
        np.concatenate([rays[singles] for rays, _, singles in parts]),
    )


def _tile_structs(tiles: Indices, bases: Doubles, low: Doubles, high: Doubles) -> npt.NDArray[np.void]:
    structs = struct_zeros(Tile, len(tiles))
    for k, name in enumerate(("axis", "u", "v")):
        structs[name] = bases[:, k]
    for k, name in enumerate("pq"):
        structs[f"{name}_low"], structs[f"{name}_high"] = low[..., k], high[..., k]
    structs["packets"] = ((tiles >= 0).any(axis=2) << np.arange(PACKETS)).sum(axis=1)
    return structs


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
    chunks = _in_parts(np.arange(len(directions)), directions, CHUNK) if len(directions) else []
    whole = np.array([c for c in chunks if len(c) == CHUNK], np.int64).reshape(-1, CHUNK)
    candidates = _halved_to(whole, directions, TILE)
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
    mean = d.mean(axis=-2)
    along = np.einsum("...nk,...k->...n", d, mean).min(axis=-1, initial=1.0)
    return along > WIDEST * np.linalg.norm(mean, axis=-1)


def _in_parts(rays: Indices, directions: Doubles, size: int) -> list[Indices]:
    """Parts of this size, but for one that is smaller."""
    if len(rays) <= size:
        return [rays]
    return [part for half in _halves(rays, directions, size) for part in _in_parts(half, directions, size)]


def _halves(rays: Indices, directions: Doubles, multiple: int) -> tuple[Indices, Indices]:
    """Two parts, the first a multiple of a size, on both sides of the widest axis."""
    xyz = np.ascontiguousarray(directions[rays].T)
    count = -(-len(rays) // (2 * multiple)) * multiple
    order = np.argpartition(xyz[np.argmax(np.ptp(xyz, axis=1))], count - 1)
    return rays[order[:count]], rays[order[count:]]


def _halved_to(groups: Indices, directions: Doubles, size: int) -> Indices:
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
