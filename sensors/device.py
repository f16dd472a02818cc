"""Which Warp device a user means."""

import warp as wp

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of


def find_device(device: wp.DeviceLike) -> wp.Device:
    """None is CUDA if it is present, else the CPU. Raises InputError for a device that is not there."""
    wp.init()
    if device is None:
        return wp.get_preferred_device()
    try:
        return wp.get_device(device)
    except (ValueError, RuntimeError):
        names = [found.alias for found in wp.get_devices()]
        raise InputError(f"no device {str(device)!r}, {expected_one_of(str(device), names)}") from None
