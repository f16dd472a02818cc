"""Checks while a CUDA graph is captured: the captured launches run again later and must find their memory in place."""

import warp as wp

from .errors import InputError


def is_captured(device: wp.Device) -> bool:
    """Whether launches on this device are being captured into a CUDA graph."""
    return bool(device.is_cuda and device.is_capturing)


def require_as_before(what: str, device: wp.Device) -> None:
    """Raise InputError while a graph is captured, for something that would have to be copied to the device now."""
    if is_captured(device):
        raise InputError(f"{what} while a CUDA graph is captured, expected the same reading once before the capture")


def require_on_device(what: str, got: str, device: wp.Device) -> None:
    """Raise InputError while a graph is captured, for data on the host: a replay would copy it after it is freed.

    got: the data, as the message calls it.
    """
    if is_captured(device):
        raise InputError(f"{what}: got {got} while a CUDA graph is captured, expected Warp arrays on {device}")
