"""Arrays kept on disk, so that a second start reads what the first worked out.

They are kept under the digest of all that they come from: the arrays given and the source of rigcast.kernels. So
nothing in the folder is ever out of date, and what no longer matches is merely unused, until it is the oldest and makes
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
    """Where arrays are kept; None where they are not."""
    wanted = os.environ.get("RIGCAST_CACHE", "")
    if wanted == "off":
        return None
    start_warp()
    return Path(wanted) if wanted else Path(wp.config.kernel_cache_dir) / "rigcast_trees"


def kept_arrays(names: Collection[str], digest: str, make: Callable[[], Arrays]) -> Arrays:
    """The arrays of these names that `make` works out from what has this digest, read from disk where it did before."""
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
    """Tells apart what comes from these arrays, and from the code that is here now."""
    digest = hashlib.sha256(_makers())
    for array in sources:
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()[:40]


@cache
def _makers() -> bytes:
    """The digest of the code that works arrays out and lays them out."""
    (folder,) = rigcast.kernels.__path__
    digest = hashlib.sha256()
    for file in sorted(Path(folder).rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.digest()


def read_arrays(path: Path) -> Arrays | None:
    """The arrays in a file, None where there is none that is whole: zip files carry a checksum of each array."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
        os.utime(path)  # used now
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
        return None
    return arrays


def keep_arrays(arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write a file that appears whole or not at all, whoever else writes it now; warn where that cannot be done."""
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
    """Remove the files that were used longest ago until `size` more bytes are within MAX_BYTES."""
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
