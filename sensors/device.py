"""Which Warp device a user means."""

import os
from contextlib import suppress
from pathlib import Path

import warp as wp

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of


def find_device(device: wp.DeviceLike) -> wp.Device:
    """None is CUDA if it is present, else the CPU.

    Raises InputError for a device that is not there, and where no kernel is compiled nor can be.
    """
    _start_warp()
    if device is None:
        return wp.get_preferred_device()
    # for "cuda" Warp would ask a driver that is missing, and print errors of its own
    if str(device) != "cuda" or wp.is_cuda_available():
        with suppress(ValueError, RuntimeError):
            return wp.get_device(device)
    names = [found.alias for found in wp.get_devices()]
    raise InputError(f"no device {str(device)!r}, {expected_one_of(str(device), names)}")


def _start_warp() -> None:
    try:
        wp.init()
    except OSError as error:
        raise _unwritable(str(error.filename)) from None
    folder = str(wp.config.kernel_cache_dir)
    if not os.access(folder, os.W_OK) and not any(Path(folder).glob("wp_rigcast.*")):
        raise _unwritable(folder)


def _unwritable(folder: str) -> InputError:
    return InputError(f"{folder}: kernels cannot be written there; WARP_CACHE_PATH can name another folder for them")
