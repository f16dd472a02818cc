"""Stores of data sets: a folder, or a URL that fsspec supports, such as one of an object store."""

from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, Protocol

from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra


class Store(Protocol):
    """The files of a data set by their relative names, such as room/000000/frames.npz."""

    def where(self, name: str) -> str:
        """The name of a file in messages."""

    def open(self, name: str) -> BufferedReader:
        """Open a file for reading and seeking; only the parts read are fetched. Raises OSError on failure."""


@dataclass(frozen=True)
class FolderStore:
    folder: Path

    def where(self, name: str) -> str:
        return str(self.folder / name)

    def open(self, name: str) -> BufferedReader:
        return (self.folder / name).open("rb")


@dataclass(frozen=True)
class UrlStore:
    """A store at a URL. fsspec keeps connections per process."""

    url: str

    def where(self, name: str) -> str:
        return f"{self.url.rstrip('/')}/{name}"

    def open(self, name: str) -> BufferedReader:
        fsspec: Any = load_extra(f"{self.url}: a data set at a URL", "fsspec", "remote")
        try:
            files, path = fsspec.core.url_to_fs(self.where(name))
        except (ImportError, ValueError) as error:  # the library for such URLs is not installed, or none exists
            raise InputError(f"{self.url}: {error}") from None
        return files.open(path, "rb")


def is_url(location: str | Path) -> bool:
    return isinstance(location, str) and "://" in location


def store_at(location: str | Path) -> Store:
    return UrlStore(str(location)) if is_url(location) else FolderStore(Path(location))
