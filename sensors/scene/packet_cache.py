"""Packets of rays kept on disk, so that a second start with the same sensor does not sort its rays."""

import warp as wp

from rigcast.kernels.packets.firings import sort_rays
from rigcast.kernels.packets.packet import Packet, Tile
from rigcast.kernels.packets.sorting import Packets

from .disk_cache import Arrays, cache_folder, keep_arrays, place_of, read_arrays

FEWEST_RAYS = 4096
"""Fewer are sorted sooner than read."""

_TYPES = {"tiles": Tile, "packets": Packet, "singles": int, "firing": int}


def cached_packets(directions: wp.array, firing: wp.array | None) -> Packets:
    """What `sort_rays` makes of them, read from disk where they were sorted before."""
    folder = cache_folder()
    if folder is None or directions.size < FEWEST_RAYS:
        return sort_rays(directions, firing)
    path = place_of(folder, *(given.numpy() for given in (directions, firing) if given is not None))
    packets = _packets(read_arrays(path), firing is not None)
    if packets is None:
        packets = sort_rays(directions, firing)
        arrays = {name: getattr(packets, name) for name in _names(firing is not None)}
        keep_arrays({name: array.numpy() for name, array in arrays.items()}, path)
    return packets


def _packets(arrays: Arrays | None, has_firings: bool) -> Packets | None:
    """The packets of these arrays, None if they are not all there."""
    if arrays is None or arrays.keys() != set(_names(has_firings)):
        return None
    return Packets(**{name: wp.array(array, dtype=_TYPES[name], device="cpu") for name, array in arrays.items()})


def _names(has_firings: bool) -> list[str]:
    return [name for name in _TYPES if has_firings or name != "firing"]
