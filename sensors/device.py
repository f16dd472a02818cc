"""Which Warp device a user means."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EACCES
from pathlib import Path
from typing import TYPE_CHECKING, Any

import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.launching.launch import start_warp
from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of

if TYPE_CHECKING:

    class DeviceArray(wp.array):  # type: ignore[misc]  # of which this project's mypy knows nothing
        """A Warp array, of whose `numpy()` Warp says nothing to type checkers."""

        def numpy(self) -> NDArray[Any]: ...
else:
    DeviceArray = wp.array


def find_device(device: wp.DeviceLike) -> wp.Device:
    """None is CUDA if it is present, else the CPU.

    Raises InputError for a device that is not there, and where no kernel is compiled nor can be.
    """
    _require_started()
    if device is None:
        return wp.get_preferred_device()
    # for "cuda" Warp would ask a driver that is missing, and print errors of its own
    if str(device) != "cuda" or wp.is_cuda_available():
        with suppress(ValueError, RuntimeError):
            return wp.get_device(device)
    names = [found.alias for found in wp.get_devices()]
    raise InputError(f"no device {str(device)!r}, {expected_one_of(str(device), names)}")


@contextmanager
def compiling() -> Iterator[None]:
    """Raise InputError where the body, which writes no other files, cannot write a kernel."""
    try:
        yield
    except OSError as error:
        raise _unwritable(str(wp.config.kernel_cache_dir), error) from None


def _require_started() -> None:
    try:
        start_warp()
    except OSError as error:
        raise _unwritable(str(error.filename), error) from None
    folder = str(wp.config.kernel_cache_dir)
    if not os.access(folder, os.W_OK) and not any(Path(folder).glob("wp_rigcast.*")):
        raise _unwritable(folder, OSError(EACCES, os.strerror(EACCES)))


def _unwritable(folder: str, error: OSError) -> InputError:
    another = "WARP_CACHE_PATH can name another folder for them"
    return InputError(f"{folder}: kernels cannot be written there: {error.strerror}; {another}")
