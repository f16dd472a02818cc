"""Checks that readings fit into memory and `out`, before anything is allocated or overwritten."""

import math
import os
from collections.abc import Mapping

import warp as wp

from rigcast.sensors.captured import is_captured
from rigcast.sensors.errors import InputError, require_type

from .frame import Frame

MOST_RAYS_OF_FRAME = 2**31 - 2**20
"""Most rays of a frame: kernels count them in 32 bits, and threads that find none left count on, up to 128 each."""


def require_countable(worlds: int, rays: Mapping[str, int]) -> None:
    """Raise InputError if `worlds` worlds have too many rays. rays: per world, by sensor."""
    for name, of_each in rays.items():
        if worlds * of_each > MOST_RAYS_OF_FRAME:
            raise InputError(
                f"Rig.sense: {worlds} worlds of sensor {name!r} have {worlds * of_each} rays, expected at most "
                f"{MOST_RAYS_OF_FRAME}: {MOST_RAYS_OF_FRAME // of_each} worlds"
            )


def require_out(out: Mapping[str, Frame], shapes: Mapping[str, tuple[int, ...]], device: wp.Device) -> None:
    """Raise InputError unless `out` has a frame of each of these sensors with this shape."""
    require_type("Rig.sense: out", out, Mapping)
    for name, shape in shapes.items():
        if name not in out:
            raise InputError(
                f"Rig.sense: out: no frame of sensor {name!r}, expected a frame of each sensor that is read"
            )
        require_type(f"Rig.sense: out: sensor {name!r}", out[name], Frame)
        out[name].require_fit(name, shape, device)


def require_memory(worlds: int, needs: Mapping[str, int], meanwhile: int, device: wp.Device, kept: int) -> None:
    """Raise InputError if `worlds` worlds do not fit into memory. needs: bytes per world, by purpose.

    meanwhile: bytes that all worlds need together. kept: bytes of earlier frames, which are overwritten.
    """
    each = sum(needs.values())
    free = free_memory(device) + kept
    if worlds * each + meanwhile > free and device.is_cuda and not is_captured(device):
        wp.synchronize_device(device)  # after which what has been freed counts as free
        free = free_memory(device) + kept
    if worlds * each + meanwhile > free:
        parts = ", ".join(f"{name} {_bytes(need)}" for name, need in needs.items() if need)
        raise InputError(
            f"Rig.sense: {worlds} worlds need {_bytes(worlds * each + meanwhile)}, {_bytes(each)} each ({parts}) and "
            f"{_bytes(meanwhile)} to compute them, expected at most {max(0, free - meanwhile) // each}: "
            f"{_bytes(free)} are free on {device}"
        )


def free_memory(device: wp.Device) -> int:
    """Bytes that can be allocated now; on the CPU the available memory if the system reports it, else all of it."""
    if device.is_cuda:
        return int(device.free_memory)
    try:
        with open("/proc/meminfo") as lines:
            available = next(line for line in lines if line.startswith("MemAvailable:"))
        return int(available.split()[1]) * 1024
    except (OSError, StopIteration):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _bytes(count: float) -> str:
    """A number of bytes as text, with three significant figures."""
    power = min(int(math.log10(max(count, 1)) / 3), 4)
    return f"{count / 1000**power:.3g} {('B', 'kB', 'MB', 'GB', 'TB')[power]}"
