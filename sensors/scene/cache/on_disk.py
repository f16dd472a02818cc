"""Arrays cached on disk, so that a second start reads what the first one computed.

The key of an entry is the digest of everything it follows from: input arrays and the source of rigcast.kernels. So
no entry is ever out of date; one that no longer matches is merely unused, until it is the oldest and makes
room. The environment variable RIGCAST_CACHE names another folder, or is `off`; else the folder is `rigcast_trees` in
that of Warp's compiled kernels, whose layout the arrays share. It holds up to MAX_BYTES.
"""

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

import rigcast.kernels
from rigcast.kernels.launching.launch import start_warp
from rigcast.sensors.errors import warn_user

MAX_BYTES = 4 * 2**30

Arrays = dict[str, NDArray[Any]]


def cache_folder() -> Path | None:
    """The folder of the cache; None if it is off."""
    wanted = os.environ.get("RIGCAST_CACHE", "")
    if wanted == "off":
        return None
    start_warp()
    return Path(wanted) if wanted else Path(wp.config.kernel_cache_dir) / "rigcast_trees"


def kept_arrays(names: Collection[str], digest: str, make: Callable[[], Arrays]) -> Arrays:
    """The arrays of these names with this digest, read from disk if they are there, else made by `make` and stored."""
    folder = cache_folder()
    if folder is None:
        return make()
    path = folder / f"{digest}.npz"
    arrays = read_arrays(path)
    if arrays is None or arrays.keys() != set(names):
        arrays = make()
        keep_arrays(arrays, path)
    return arrays


def digest_of(sources: Iterable[NDArray[Any]]) -> str:
    """A digest of these arrays and of the present code."""
    digest = hashlib.sha256(_makers())
    for array in sources:
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()[:40]


@cache
def _makers() -> bytes:
    """The digest of the code that computes the arrays and defines their layout."""
    (folder,) = rigcast.kernels.__path__
    digest = hashlib.sha256()
    for file in sorted(Path(folder).rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.digest()


def read_arrays(path: Path) -> Arrays | None:
    """The arrays in a file; None if there is no intact one. Zip files contain a checksum of each array."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
        os.utime(path)  # marks the file as used now
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
        return None
    return arrays


def keep_arrays(arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write a file atomically, even if others write it at the same time; warn if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _make_room(path.parent, sum(array.nbytes for array in arrays.values()))
        with tempfile.TemporaryDirectory(dir=path.parent) as own:
            written = Path(own) / path.name
            np.savez(written, **arrays)  # type: ignore[arg-type]
            os.replace(written, path)
    except OSError as error:
        message = f"{path.parent}: nothing can be kept there, so every start works it out anew: {error}"
        warn_user(message, RuntimeWarning)


def _make_room(folder: Path, size: int) -> None:
    """Remove the least recently used files until `size` more bytes fit within MAX_BYTES."""
    for used, file in sorted(_by_use(folder), reverse=True):
        size += used[1]
        if size > MAX_BYTES:
            file.unlink(missing_ok=True)


def _by_use(folder: Path) -> Iterator[tuple[tuple[float, int], Path]]:
    """The time of last use [s] and the size of each file; others may remove it meanwhile."""
    for place, _, names in os.walk(folder):  # what a killed process left in a folder of its own, too
        for file in (Path(place, name) for name in names if name.endswith(".npz")):
            with suppress(FileNotFoundError):
                stat = file.stat()
                yield (stat.st_mtime, stat.st_size), file
