"""While a CUDA graph is captured: what is launched then runs later, again and again, and must find its memory there."""

import warp as wp

from .errors import InputError


def is_captured(device: wp.Device) -> bool:
    """Whether what is launched on this device goes into a CUDA graph."""
    return bool(device.is_cuda and device.is_capturing)


def require_as_before(what: str, device: wp.Device) -> None:
    """Raise InputError for what is to be copied to the device now, if that is while a graph is captured, as above."""
    if is_captured(device):
        raise InputError(f"{what} while a CUDA graph is captured, expected a reading as this one before it")


def require_on_device(what: str, got: str, device: wp.Device) -> None:
    """Raise InputError for what is on the host while a graph is captured, which would copy from there when it is gone.

    got: what is there, as a message calls it.
    """
    if is_captured(device):
        raise InputError(f"{what}: got {got} while a CUDA graph is captured, expected Warp arrays on {device}")
