"""Triangle trees kept on disk, so that a second start with the same meshes does not build them.

A tree is kept under the digest of all that it comes from: vertices, faces and the source of rigcast.kernels. So nothing
in the folder is ever out of date, and what no longer matches is merely unused, until it is the oldest and makes room.
The environment variable RIGCAST_CACHE names another folder, or is `off`; else the folder is `rigcast_trees` in that of
Warp's compiled kernels, whose layout the trees share. It holds up to MAX_BYTES.
"""

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

import rigcast.kernels
from rigcast.kernels.geometry import TriangleTree
from rigcast.kernels.triangle_tree import build_triangle_tree
from rigcast.sensors.errors import warn_user

MAX_BYTES = 4 * 2**30
FEWEST_FACES = 1000
"""Trees of fewer faces are built sooner than read."""


def cached_triangle_tree(vertices: ArrayLike, faces: ArrayLike) -> TriangleTree:
    """What build_triangle_tree makes of them, read from disk where it was built before; raises what that raises."""
    v, f = np.asarray(vertices), np.asarray(faces)
    folder = cache_folder()
    if folder is None or len(f) < FEWEST_FACES:
        return build_triangle_tree(v, f)
    path = folder / f"{_digest(v, f)}.npz"
    tree = _read(path)
    if tree is None:
        tree = build_triangle_tree(v, f)
        _keep(tree, path)
    return tree


def cache_folder() -> Path | None:
    """Where trees are kept; None where they are not."""
    wanted = os.environ.get("RIGCAST_CACHE", "")
    if wanted == "off":
        return None
    wp.init()
    return Path(wanted) if wanted else Path(wp.config.kernel_cache_dir) / "rigcast_trees"


def _digest(vertices: NDArray[np.generic], faces: NDArray[np.generic]) -> str:
    digest = hashlib.sha256(_builder())
    for array in (vertices, faces):
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()[:40]


@cache
def _builder() -> bytes:
    """The digest of the code that builds trees and lays them out."""
    (folder,) = rigcast.kernels.__path__
    digest = hashlib.sha256()
    for file in sorted(Path(folder).rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.digest()


def _read(path: Path) -> TriangleTree | None:
    """The tree in a file, None where there is none that is whole: zip files carry a checksum of each array."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            tree = TriangleTree(**{field.name: _plain(arrays[field.name]) for field in fields(TriangleTree)})
        os.utime(path)  # used now
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
        return None
    return tree


def _plain(array: NDArray[np.generic]) -> Any:
    return array if array.ndim else array.item()


def _keep(tree: TriangleTree, path: Path) -> None:
    """Write a file that appears whole or not at all, whoever else writes it now."""
    arrays: dict[str, Any] = {field.name: np.asarray(getattr(tree, field.name)) for field in fields(TriangleTree)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _make_room(path.parent, sum(array.nbytes for array in arrays.values()))
        with tempfile.TemporaryDirectory(dir=path.parent) as own:
            written = Path(own) / path.name
            np.savez(written, **arrays)
            os.replace(written, path)
    except OSError as error:
        warn_user(f"{path.parent}: a tree cannot be kept, so it is built at every start: {error}", RuntimeWarning)


def _make_room(folder: Path, size: int) -> None:
    """Remove the files that were used longest ago until `size` more bytes are within MAX_BYTES."""
    for used, file in sorted(_by_use(folder), reverse=True):
        size += used[1]
        if size > MAX_BYTES:
            file.unlink(missing_ok=True)


def _by_use(folder: Path) -> Iterator[tuple[tuple[float, int], Path]]:
    """The time of last use [s] and the size of each file; others may remove it meanwhile."""
    for file in folder.rglob("*.npz"):  # what a killed process left in a folder of its own, too
        with suppress(FileNotFoundError):
            stat = file.stat()
            yield (stat.st_mtime, stat.st_size), file
