"""Atomic writing of files, and checks that folders are writable before work begins."""

import errno
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rigcast.sensors.errors import InputError


@contextmanager
def replacing(path: Path, mark: str = "") -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`, renamed to `path` when the body has succeeded.

    Whatever ends the body otherwise, the temporary file is removed and `path` stays as it was. mark: in its name, where
    several processes may write the same file.

    Raises:
        InputError: the file cannot be written (OSError in the body: folder gone, disk full, no permission).
    """
    temporary = path.with_name(f".{path.name}{mark}.part")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def make_writable(folder: Path) -> None:
    """Create `folder` if needed and test it by writing a temporary file.

    Raises:
        InputError: it is not a folder, cannot be created, or files cannot be written in it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"rigcast")
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{folder}: the output folder cannot be written: {reason}") from error


def make_room_for(file: Path) -> None:
    """Create the folder of a file if needed and test it as `make_writable` does.

    Raises:
        InputError: a folder has the file's name, or its own cannot be written.
    """
    if file.is_dir():
        raise InputError(f"{file}: is a folder, expected the name of a file")
    make_writable(file.parent)


def require_disk_space(folder: Path, size: int) -> None:
    """Raise OSError(ENOSPC) if less than `size` bytes are free.

    Called before each frame with the bytes needed to close the files, so that they can be completed on a full disk.
    """
    if shutil.disk_usage(folder).free < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer Ctrl-C until the body is done, then raise KeyboardInterrupt; a second Ctrl-C is not deferred.

    Only the main thread gets Ctrl-C; in others this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pressed: list[int] = []

    def hold(number: int, _where: Any) -> None:
        pressed.append(number)
        signal.signal(signal.SIGINT, usual)

    usual = signal.signal(signal.SIGINT, hold)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
    if pressed:
        raise KeyboardInterrupt
