"""Packets of rays kept on disk, so that a second start with the same sensor does not sort its rays."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.packets.packet import Packet, Tile
from rigcast.kernels.packing.sorting import Packets, sort_into_packets

from .disk_cache import Arrays, kept_arrays

FEWEST_RAYS = 4096
"""Fewer are sorted sooner than read."""

_TYPES = {"tiles": Tile, "packets": Packet, "singles": int}


def cached_packets(directions: wp.array, group: NDArray[np.int32] | None) -> Packets:
    """What `sort_into_packets` makes of (n,) vec3d, read from disk where they were sorted before."""
    unit = directions.numpy()
    if directions.size < FEWEST_RAYS:
        return sort_into_packets(unit, group)
    sources = [unit] if group is None else [unit, group]
    arrays = kept_arrays(_TYPES, sources, lambda: _arrays(sort_into_packets(unit, group)))
    kept = {name: wp.array(arrays[name], dtype=kind, device="cpu", copy=False) for name, kind in _TYPES.items()}
    return Packets(**kept)


def _arrays(packets: Packets) -> Arrays:
    return {name: getattr(packets, name).numpy() for name in _TYPES}
