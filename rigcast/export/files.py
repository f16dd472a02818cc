"""Files that appear whole or not at all, and folders known to be writable before work begins."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rigcast.sensors.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`, renamed to `path` when the body has succeeded.

    Whatever ends the body otherwise, the temporary file is removed and `path` stays as it was.

    Raises:
        InputError: the file cannot be written (OSError in the body: folder gone, disk full, no permission).
    """
    temporary = path.with_name(f".{path.name}.part")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def make_writable(folder: Path) -> None:
    """Create `folder` if need be and try it with a file that leaves no trace.

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
