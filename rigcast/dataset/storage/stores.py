"""Where a data set is read: in a folder, or at a URL that fsspec knows, such as one of an object store."""

from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, Protocol

from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra


class Store(Protocol):
    """The files of a data set, by their names in it, such as room/000000/frames.npz."""

    def where(self, name: str) -> str:
        """What a message calls a file."""

    def open(self, name: str) -> BufferedReader:
        """A file to read and to seek in, of which no more comes than is read. Raises OSError where it cannot be."""


@dataclass(frozen=True)
class FolderStore:
    folder: Path

    def where(self, name: str) -> str:
        return str(self.folder / name)

    def open(self, name: str) -> BufferedReader:
        return (self.folder / name).open("rb")


@dataclass(frozen=True)
class UrlStore:
    """fsspec keeps connections, in each process its own."""

    url: str

    def where(self, name: str) -> str:
        return f"{self.url.rstrip('/')}/{name}"

    def open(self, name: str) -> BufferedReader:
        fsspec: Any = load_extra(f"{self.url}: a data set at a URL", "fsspec", "remote")
        try:
            files, path = fsspec.core.url_to_fs(self.where(name))
        except (ImportError, ValueError) as error:  # the library for such URLs is missing, or there is none
            raise InputError(f"{self.url}: {error}") from None
        return files.open(path, "rb")


def is_url(location: str | Path) -> bool:
    return isinstance(location, str) and "://" in location


def store_at(location: str | Path) -> Store:
    return UrlStore(str(location)) if is_url(location) else FolderStore(Path(location))
