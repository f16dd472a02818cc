"""Packets of rays cached on disk, so that a second start with the same sensor does not sort its rays."""

from weakref import WeakValueDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.packets.packet import Packet, Tile
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.coherent import Packets

from .on_disk import Arrays, digest_of, kept_arrays

FEWEST_RAYS = 4096
"""Least number of rays that are cached; sorting fewer is faster than reading them."""

_in_use: WeakValueDictionary[str, Packets] = WeakValueDictionary()
"""Packets in use by sensors, by the digest of their rays."""

_TYPES = {"tiles": Tile, "packets": Packet, "singles": int}


def cached_packets(directions: wp.array, group: NDArray[np.int32] | None) -> Packets:
    """The packets that `sort_into_packets` makes of directions (n,) vec3d, read from disk if they were sorted before.

    Sensors with the same rays share packets, which nobody writes to.
    """
    unit = directions.numpy()
    if directions.size < FEWEST_RAYS:
        return sort_into_packets(unit, group)
    digest = digest_of([unit] if group is None else [unit, group])
    packets = _in_use.get(digest)
    if packets is None:
        arrays = kept_arrays(_TYPES, digest, lambda: _arrays(sort_into_packets(unit, group)))
        kept = {name: wp.array(arrays[name], dtype=kind, device="cpu", copy=False) for name, kind in _TYPES.items()}
        packets = _in_use[digest] = Packets(**kept)
    return packets


def _arrays(packets: Packets) -> Arrays:
    return {name: getattr(packets, name).numpy() for name in _TYPES}
