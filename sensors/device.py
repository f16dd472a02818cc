"""The Warp device that a user asks for."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EACCES
from json import JSONDecodeError
from pathlib import Path
from typing import TYPE_CHECKING, Any

import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.launching.launch import start_warp
from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of

if TYPE_CHECKING:

    class DeviceArray(wp.array):  # type: ignore[misc]  # of which this project's mypy knows nothing
        """A Warp array with a typed `numpy()`, which Warp does not declare."""

        def numpy(self) -> NDArray[Any]: ...
else:
    DeviceArray = wp.array


def find_device(device: wp.DeviceLike) -> wp.Device:
    """The Warp device of this name; for None CUDA if present, else the CPU.

    Raises InputError for a device that does not exist, and if there are no compiled kernels and none can be written.
    """
    _require_started()
    if device is None:
        return wp.get_preferred_device()
    # without a CUDA driver, Warp would print errors of its own for "cuda"
    if str(device) != "cuda" or wp.is_cuda_available():
        with suppress(ValueError, RuntimeError):
            return wp.get_device(device)
    names = [found.alias for found in wp.get_devices()]
    raise InputError(f"no device {str(device)!r}, {expected_one_of(str(device), names)}")


@contextmanager
def compiling() -> Iterator[None]:
    """Raise InputError if the body cannot write a kernel, or read one back; it must use no other files."""
    try:
        yield
    except OSError as error:
        raise _unwritable(str(wp.config.kernel_cache_dir), error) from None
    except JSONDecodeError as error:  # of what Warp writes beside each kernel
        raise _damaged(error) from None
    except Exception as error:  # Warp has no class of its own for it
        if not re.match("Failed to load (CPU|CUDA) module", str(error)):
            raise
        raise _damaged(error) from None


def _require_started() -> None:
    try:
        start_warp()
    except OSError as error:
        raise _unwritable(str(error.filename), error) from None
    folder = str(wp.config.kernel_cache_dir)
    if not os.access(folder, os.W_OK) and not any(Path(folder).glob("wp_rigcast.*")):
        raise _unwritable(folder, OSError(EACCES, os.strerror(EACCES)))


def _damaged(error: Exception) -> InputError:
    folder = wp.config.kernel_cache_dir  # which Warp sets when it starts
    return InputError(f"{folder}: a kernel there is damaged: {error}; delete the folder, and kernels are compiled anew")


def _unwritable(folder: str, error: OSError) -> InputError:
    another = "WARP_CACHE_PATH can name another folder for them"
    return InputError(f"{folder}: kernels cannot be written there: {error.strerror}; {another}")
