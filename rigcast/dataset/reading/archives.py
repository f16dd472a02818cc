"""The arrays of a shard, each read on access."""

import weakref
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from io import BufferedReader
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rigcast.dataset.storage.manifest import shard_name
from rigcast.dataset.storage.shards import FRAMES_NAME, IDS_NAME
from rigcast.dataset.storage.stores import Store
from rigcast.export.ids import IdTable
from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra


class Archive(Protocol):
    """The arrays of one shard."""

    def read(self, sensor: str, number: int, name: str) -> NDArray[Any]:
        """One array. Raises KeyError if the frame has none of this name."""

    def names(self, sensor: str, number: int) -> Iterable[str]:
        """The names of a frame's arrays, in alphabetical order."""


class _NpzArchive:
    def __init__(self, store: Store, name: str) -> None:
        file = store.open(name)
        weakref.finalize(self, file.close)
        self._file = np.load(file, allow_pickle=False)

    def read(self, sensor: str, number: int, name: str) -> NDArray[Any]:
        return self._file[f"{sensor}/{number:06d}/{name}"]

    def names(self, sensor: str, number: int) -> Iterable[str]:
        prefix = f"{sensor}/{number:06d}/"
        return sorted(name.removeprefix(prefix) for name in self._file.files if name.startswith(prefix))


class _ZarrParts(Mapping[str, Any]):
    """The parts of a Zarr store packed in one file, as buffers of this type, read on access."""

    def __init__(self, file: BufferedReader, buffer: Any) -> None:
        weakref.finalize(self, file.close)
        self._archive, self._buffer = zipfile.ZipFile(file), buffer
        self._names = frozenset(self._archive.namelist())

    def __getitem__(self, name: str) -> Any:
        return self._buffer.from_bytes(self._archive.read(name))

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class _ZarrArchive:
    def __init__(self, store: Store, name: str) -> None:
        zarr: Any = load_extra("a data set of format zarr", "zarr", "zarr")
        parts = _ZarrParts(store.open(name), zarr.core.buffer.cpu.Buffer)
        self._root = zarr.open_group(zarr.storage.MemoryStore(parts, read_only=True), mode="r")

    def read(self, sensor: str, number: int, name: str) -> NDArray[Any]:
        group = self._root[sensor]
        return np.array(group.attrs[name]) if name in group.attrs else group[name][number]

    def names(self, sensor: str, _number: int) -> Iterable[str]:
        group = self._root[sensor]
        return sorted([*group.array_keys(), *(name for name in group.attrs if name not in ("type", "spec"))])


class StoredShard:
    """The files of an episode: its entry in the manifest, its arrays, and the meaning of its ids.

    Raises InputError for a damaged file or a missing library; OSError as the store does.
    """

    def __init__(self, store: Store, entry: Mapping[str, Any]) -> None:
        self.entry, self.archive = entry, _archive_of(store, entry)
        self._store = store

    @cached_property
    def ids(self) -> IdTable:
        with self._store.open(f"{shard_name(self.entry)}/{IDS_NAME}") as file:
            return IdTable.from_json(file.read().decode())


def _archive_of(store: Store, entry: Mapping[str, Any]) -> Archive:
    kinds: dict[str, Callable[[Store, str], Archive]] = {"npz": _NpzArchive, "zarr": _ZarrArchive}
    (form,) = [name for name, file in FRAMES_NAME.items() if file in entry["files"]]
    name = f"{shard_name(entry)}/{FRAMES_NAME[form]}"
    try:
        return kinds[form](store, name)
    except (zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{store.where(name)}: cannot be read: {error}; verify() names all such files") from None
