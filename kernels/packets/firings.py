"""Packets of rays that leave one after the other."""

import numpy as np
import numpy.typing as npt
import warp as wp

from .packet import Packet, Tile
from .sorting import Doubles, Packets, sort_into_packets


def sort_firings(directions: Doubles, firing: npt.NDArray[np.integer]) -> Packets:
    """Sort rays with unit directions (n, 3) so that those of a tile belong to one firing; firing (n,) says which."""
    order = np.argsort(firing, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(firing[order])) + 1)
    parts = [(rays, sort_into_packets(directions[rays])) for rays in groups if len(rays)]
    return Packets(
        _joined(Tile, [part.tiles.numpy() for _, part in parts]),
        _joined(Packet, [_numbered(part.packets.numpy(), rays) for rays, part in parts]),
        _joined(int, [rays[part.singles.numpy()] for rays, part in parts]),
        _joined(int, [np.full(part.tiles.size, firing[rays[0]]) for rays, part in parts]),
    )


def _numbered(packets: npt.NDArray[np.void], rays: npt.NDArray[np.intp]) -> npt.NDArray[np.void]:
    """Packets whose ray k is now rays[k]."""
    packets = packets.copy()
    packets["ray"] = np.where(packets["ray"] >= 0, rays[packets["ray"]], -1)
    return packets


def _joined(dtype: type, parts: list[npt.NDArray[np.generic]]) -> wp.array:
    joined = wp.empty(sum(len(part) for part in parts), dtype=dtype, device="cpu")
    if parts:
        joined.numpy()[...] = np.concatenate(parts)
    return joined
