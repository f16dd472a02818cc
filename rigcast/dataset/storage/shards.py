"""A shard: the folder with all frames of one episode, which appears only when it is complete.

    DIR/<scene>/<episode>/frames.npz or frames.zarr.zip    the frames
    DIR/<scene>/<episode>/ids.json                         the meaning of ids, see IdTable
    DIR/<scene>/<episode>/exr/<sensor>/000000.exr          depth cameras, on request
    DIR/<scene>/<episode>/<sensor>.png                     a preview, in the first episode of a scene
    DIR/<scene>/<episode>/entry.json                       its entry in the manifest

frames.npz has the arrays `<sensor>/<number>/<field>`, with the number in six digits; frames.zarr.zip is the store that
`rigcast run --format zarr` writes, in one file. Fields are those that the data set chooses, time and pose, and of a
depth camera what `camera_fields` has. Files of the same frames are the same byte for byte: archives bear no date, and
their parts stand in one order.
"""

import errno
import hashlib
import json
import os
import shutil
import uuid
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np

from rigcast.dataset.description.file import Output
from rigcast.export.fields import FIELD_NAMES, camera_fields, fields_of
from rigcast.export.files import require_disk_space
from rigcast.export.frames.exr import write_exr
from rigcast.export.ids import Classes, IdTable
from rigcast.export.zarr_store import ZarrStore
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.rig.rig import Rig

from .statistics import SensorStatistics

ENTRY_NAME = "entry.json"
IDS_NAME = "ids.json"
UNFINISHED_NAME = "unfinished"
FRAMES_NAME = {"npz": "frames.npz", "zarr": "frames.zarr.zip"}

_ROOM = 2**24  # bytes kept free for completing a shard
_PER_RAY = 256  # bytes of all fields of a ray, rounded up, with the copy that packing a store takes


class _Frames(Protocol):
    def write(self, frame: Frame) -> None: ...

    def finish(self) -> None: ...

    def close(self) -> None: ...


class Shard:
    """A shard being written, in a folder beside the complete ones."""

    def __init__(self, folder: Path, rig: Rig, classes: Classes, output: Output, *, pictured: bool) -> None:
        self._folder, self._output, self._pictured = folder, output, pictured
        self._ids = IdTable.of(rig.model, classes, rig.props)
        self._statistics = {spec.name: SensorStatistics(spec.type) for spec in rig.sensors}
        self._latest: dict[str, Frame] = {}
        (folder / IDS_NAME).write_text(self._ids.json())
        self._frames: _Frames = (
            _NpzFrames(folder / FRAMES_NAME["npz"], output.fields)
            if output.format == "npz"
            else _ZarrFrames(folder, rig, self._ids, output.fields)
        )

    def write(self, frame: Frame) -> None:
        """Append a frame. Raises OSError where it cannot be written."""
        require_disk_space(self._folder, _ROOM + _PER_RAY * int(frame.range.size))
        statistics = self._statistics[frame.sensor]
        if self._output.exr and isinstance(frame, CameraFrame):
            path = self._folder / "exr" / frame.sensor / f"{len(statistics.times):06d}.exr"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_exr(path, frame, self._ids)
        self._frames.write(frame)
        statistics.add(frame)
        self._latest[frame.sensor] = frame

    def finish(self, about: Mapping[str, Any]) -> dict[str, Any]:
        """Complete all files and write entry.json, which it returns: `about`, with files and statistics."""
        self._frames.finish()
        for name, frame in self._latest.items() if self._pictured else ():
            frame.picture().save(self._folder / f"{name}.png", format="png")
        paths = sorted(path for path in self._folder.rglob("*") if path.is_file())
        files = {path.relative_to(self._folder).as_posix(): _sealed(path) for path in paths}
        sensors = {name: statistics.entry() for name, statistics in self._statistics.items()}
        entry = {**about, "sensors": sensors, "files": files}
        (self._folder / ENTRY_NAME).write_text(json.dumps(entry))
        _sealed(self._folder / ENTRY_NAME)
        return entry

    def close(self) -> None:
        """Release the files."""
        self._frames.close()


@contextmanager
def appearing(folder: Path, name: str) -> Iterator[Path]:
    """Yield an empty folder that becomes `folder / name` when the body has succeeded, and vanishes when it has not.

    If another worker has made the same folder meanwhile, that one stays; it is the same. Raises InputError if
    somebody has removed the folder, as `sweep` does that of another job.
    """
    place = folder / name
    temporary = folder / UNFINISHED_NAME / f"{name.replace('/', '-')}.{uuid.uuid4().hex}"
    temporary.mkdir(parents=True)
    try:
        yield temporary
        place.parent.mkdir(parents=True, exist_ok=True)
        try:
            temporary.rename(place)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST) or not (place / ENTRY_NAME).is_file():
                raise
    except OSError:
        if temporary.is_dir():
            raise
        job = "if another job makes the same episodes here, give each its --shard"
        raise InputError(f"{temporary.parent} was removed while the episode was written to it; {job}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        with suppress(OSError):  # other workers still use it
            temporary.parent.rmdir()


def without_entry(folder: Path, names: Sequence[str]) -> list[Path]:
    """The folders of these shards without an entry: a shard appears with its entry, but may be copied in part.

    A power failure may leave such folders, too.
    """
    places = [folder / name for name in names]
    return [place for place in places if place.is_dir() and not (place / ENTRY_NAME).is_file()]


def sweep(folder: Path, names: Sequence[str]) -> None:
    """Remove what killed workers have left of these shards, and shards without an entry."""
    for place in without_entry(folder, names):
        shutil.rmtree(place, ignore_errors=True)
    mine = {name.replace("/", "-") for name in names}
    unfinished = folder / UNFINISHED_NAME
    for path in unfinished.iterdir() if unfinished.is_dir() else ():
        if path.name.rpartition(".")[0] in mine:
            shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        unfinished.rmdir()


class _NpzFrames:
    """The arrays of frames in one NPZ file, written as they come."""

    def __init__(self, path: Path, fields: Mapping[str, Sequence[str]]) -> None:
        self._fields = fields
        self._file = zipfile.ZipFile(path, "w")
        self._counts: dict[str, int] = {}

    def write(self, frame: Frame) -> None:
        number = self._counts.get(frame.sensor, 0)
        self._counts[frame.sensor] = number + 1
        chosen = self._fields.get(frame.sensor, FIELD_NAMES)
        fields = {"time": np.float64(frame.time), "pose": frame.pose, **fields_of(frame, chosen)}
        if isinstance(frame, CameraFrame):
            fields |= camera_fields(frame)
        for name, field in fields.items():
            with _part(self._file, f"{frame.sensor}/{number:06d}/{name}.npy") as part:
                np.lib.format.write_array(part, np.asarray(field), allow_pickle=False)

    def finish(self) -> None:
        self.close()

    def close(self) -> None:
        self._file.close()


class _ZarrFrames(ZarrStore):
    """A Zarr store in one file: chunks as they come, then the metadata, which is in a folder until then."""

    def __init__(self, folder: Path, rig: Rig, ids: IdTable, fields: Mapping[str, Sequence[str]]) -> None:
        self._store = folder / "frames.zarr"
        super().__init__(self._store, rig.sensors, ids, fields)
        self._file = zipfile.ZipFile(folder / FRAMES_NAME["zarr"], "w")

    def write_chunk(self, key: str, chunk: bytes) -> None:
        with _part(self._file, key) as part:
            part.write(chunk)

    def finish(self) -> None:
        super().close()
        for path in sorted(self._store.rglob("*.json")):
            self.write_chunk(path.relative_to(self._store).as_posix(), path.read_bytes())
        shutil.rmtree(self._store)
        self.close()

    def close(self) -> None:
        self._file.close()


def _part(file: zipfile.ZipFile, name: str) -> IO[bytes]:
    """An uncompressed part of an archive to write to; ZipInfo has a fixed date."""
    return file.open(zipfile.ZipInfo(name), "w", force_zip64=True)


def _sealed(path: Path) -> dict[str, Any]:
    """Size and checksum of a file, after it has been flushed to disk."""
    with path.open("rb") as file:
        checksum = hashlib.file_digest(file, "sha256").hexdigest()
        os.fsync(file.fileno())
        return {"size": os.fstat(file.fileno()).st_size, "sha256": checksum}
