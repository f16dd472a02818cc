"""Packets of rays kept on disk, so that a second start with the same sensor does not sort its rays."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.packets.packet import Packet, Tile
from rigcast.kernels.packing.sorting import Packets, sort_into_packets

from .disk_cache import Arrays, cache_folder, keep_arrays, place_of, read_arrays

FEWEST_RAYS = 4096
"""Fewer are sorted sooner than read."""

_TYPES = {"tiles": Tile, "packets": Packet, "singles": int}


def cached_packets(directions: wp.array, group: NDArray[np.int32] | None) -> Packets:
    """What `sort_into_packets` makes of (n,) vec3d, read from disk where they were sorted before."""
    folder, unit = cache_folder(), directions.numpy()
    if folder is None or directions.size < FEWEST_RAYS:
        return sort_into_packets(unit, group)
    path = place_of(folder, unit, *([] if group is None else [group]))
    packets = _packets(read_arrays(path))
    if packets is None:
        packets = sort_into_packets(unit, group)
        keep_arrays({name: getattr(packets, name).numpy() for name in _TYPES}, path)
    return packets


def _packets(arrays: Arrays | None) -> Packets | None:
    """The packets of these arrays, None if they are not all there."""
    if arrays is None or arrays.keys() != _TYPES.keys():
        return None
    return Packets(**{name: wp.array(array, dtype=_TYPES[name], device="cpu") for name, array in arrays.items()})
