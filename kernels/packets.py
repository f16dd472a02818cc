"""Sorting rays from one origin into packets of neighbours, as rigcast.kernels.packet casts them.

The rays are halved, across the axis on which their directions differ most, until a tile of them is left, and the tile
is halved in the same way into its packets. Rays that have no near neighbours go alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from .packet import LANES, PACKETS, Packet, Tile
from .tree import struct_zeros

TILE = LANES * PACKETS
CHUNK = 32 * TILE
WIDEST = np.cos(np.radians(50.0))
"""No ray of a tile is farther than 50 degrees from its axis."""
SLACK = 1e-6
"""By how much ranges of p and q are widened: more than float32 rounds them."""

Indices = npt.NDArray[np.int64]
Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Packets:
    """Rays sorted into tiles of packets, on the CPU.

    singles: the rays that go alone.
    """

    tiles: wp.array
    packets: wp.array
    singles: wp.array


def sort_into_packets(directions: Doubles) -> Packets:
    """Sort rays with unit directions (n, 3)."""
    tiles, singles = _tiles_of(directions)
    axis, u, v = np.moveaxis(_bases(directions[np.maximum(tiles, 0)], tiles >= 0), 1, 0)
    d = directions[np.maximum(tiles, 0)]
    along, p, q = (np.einsum("tplk,tk->tpl", d, e) for e in (axis, u, v))
    p, q = p / along, q / along
    structs = struct_zeros(Tile, len(tiles))
    structs["axis"], structs["u"], structs["v"] = axis, u, v
    is_ray = tiles >= 0
    for name, value in (("p", p), ("q", q)):
        structs[f"{name}_low"] = np.where(is_ray, value, 9.0).min(axis=2) - SLACK
        structs[f"{name}_high"] = np.where(is_ray, value, -9.0).max(axis=2) + SLACK
    structs["packets"] = (is_ray.any(axis=2) << np.arange(PACKETS)).sum(axis=1)
    packets = struct_zeros(Packet, len(tiles) * PACKETS)
    for name, value in (
        ("ray", tiles),
        *zip("xyz", np.moveaxis(d, -1, 0), strict=True),
        ("p", p),
        ("q", q),
        ("length", 1.0 / along),
    ):
        packets[name] = value.reshape(-1, LANES)
    return Packets(
        wp.array(structs, dtype=Tile, device="cpu"),
        wp.array(packets, dtype=Packet, device="cpu"),
        wp.array(singles, dtype=int, device="cpu"),
    )


def _tiles_of(directions: Doubles) -> tuple[Indices, Indices]:
    """(tiles, PACKETS, LANES) rays, -1 where there is none, and the rays that go alone."""
    chunks = list(_halves(np.arange(len(directions)), directions, CHUNK))
    whole = np.array([c for c in chunks if len(c) == CHUNK], np.int64).reshape(-1, CHUNK)
    tiles = _halved_to(whole, directions, TILE)
    is_narrow = _is_narrow(directions[tiles])
    rest = [*tiles[~is_narrow], *(c for c in chunks if len(c) != CHUNK)]
    tiles = [*tiles[is_narrow]]
    singles = []
    for rays in rest:
        more, alone = _narrow_tiles(rays, directions)
        tiles += more
        singles += alone
    padded = np.array(tiles, np.int64).reshape(-1, TILE)
    return _halved_to(padded, directions, LANES).reshape(-1, PACKETS, LANES), np.concatenate(
        [np.empty(0, int), *singles]
    )


def _narrow_tiles(rays: Indices, directions: Doubles) -> tuple[list[Indices], list[Indices]]:
    """Tiles of up to TILE rays, filled up with -1, and lists of rays that go alone."""
    if len(rays) <= TILE and _is_narrow(directions[rays]):
        return [np.pad(rays, (0, TILE - len(rays)), constant_values=-1)], []
    if len(rays) <= LANES:
        return [], [rays]
    tiles, singles = [], []
    for half in _halves_once(rays, directions, TILE if len(rays) > TILE else LANES):
        more, alone = _narrow_tiles(half, directions)
        tiles += more
        singles += alone
    return tiles, singles


def _is_narrow(d: Doubles) -> npt.NDArray[np.bool_]:
    """(...) whether all of (..., n, 3) directions are close to their mean."""
    mean = d.mean(axis=-2)
    return np.einsum("...nk,...k->...n", d, mean).min(axis=-1) > WIDEST * np.linalg.norm(mean, axis=-1)


def _halves(rays: Indices, directions: Doubles, size: int) -> Iterator[Indices]:
    """Parts of this size, but for one that is smaller."""
    if len(rays) <= size:
        yield rays
        return
    for half in _halves_once(rays, directions, size):
        yield from _halves(half, directions, size)


def _halves_once(rays: Indices, directions: Doubles, multiple: int) -> tuple[Indices, Indices]:
    """Two parts, the first a multiple of a size, on both sides of the widest axis."""
    d = directions[rays]
    count = -(-len(rays) // (2 * multiple)) * multiple
    order = np.argpartition(d[:, np.argmax(np.ptp(d, axis=0))], count - 1)
    return rays[order[:count]], rays[order[count:]]


def _halved_to(groups: Indices, directions: Doubles, size: int) -> Indices:
    """(m, size) rays: every row of groups (n, k) halved again and again; -1 goes last."""
    while groups.shape[1] > size:
        d = np.where(groups[..., None] >= 0, directions[np.maximum(groups, 0)], np.nan)
        axis = np.argmax(np.nanmax(d, axis=1, initial=-2) - np.nanmin(d, axis=1, initial=2), axis=1)
        along = np.take_along_axis(d, axis[:, None, None], axis=2)[..., 0]
        order = np.argpartition(along, groups.shape[1] // 2 - 1, axis=1)
        groups = np.take_along_axis(groups, order, axis=1).reshape(-1, groups.shape[1] // 2)
    return groups


def _bases(d: Doubles, is_ray: npt.NDArray[np.bool_]) -> Doubles:
    """(tiles, 3, 3) axis, u, v of tiles of directions (tiles, PACKETS, LANES, 3)."""
    axis = np.where(is_ray[..., None], d, 0.0).sum(axis=(1, 2))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    aside = np.where(np.abs(axis[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    u = np.cross(aside, axis)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.stack([axis, u, np.cross(axis, u)], axis=1)
