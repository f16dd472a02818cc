"""A shard: the folder with all frames of one episode, which appears when it is whole.

    DIR/<scene>/<episode>/frames.npz or frames.zarr.zip    the frames
    DIR/<scene>/<episode>/ids.json                         what ids stand for, see IdTable
    DIR/<scene>/<episode>/exr/<sensor>/000000.exr          depth cameras, on request
    DIR/<scene>/<episode>/<sensor>.png                     a preview, in the first episode of a scene
    DIR/<scene>/<episode>/entry.json                       what the manifest says about it

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
from typing import Any, Protocol

import mujoco
import numpy as np

from rigcast.export.exr import write_exr
from rigcast.export.fields import FIELD_NAMES, camera_fields, fields_of
from rigcast.export.files import require_room
from rigcast.export.ids import Classes, IdTable
from rigcast.export.zarr_store import ZarrStore
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.rig.rig import Rig

from .file import Output
from .statistics import SensorStatistics

ENTRY_NAME = "entry.json"
UNFINISHED_NAME = "unfinished"
FRAMES_NAME = {"npz": "frames.npz", "zarr": "frames.zarr.zip"}

_ROOM = 2**24  # bytes kept free for what completes a shard
_PER_RAY = 256  # bytes of all fields of a ray, rounded up, with the copy that packing a store takes


class _Frames(Protocol):
    def write(self, frame: Frame) -> None: ...

    def close(self) -> None: ...


class Shard:
    """A shard that is being written, in a folder beside those that are whole."""

    def __init__(self, folder: Path, rig: Rig, classes: Classes, output: Output, *, pictured: bool) -> None:
        self._folder, self._output, self._pictured = folder, output, pictured
        self._ids = IdTable.of(rig.model, classes, rig.props)
        self._statistics = {spec.name: SensorStatistics(spec.type) for spec in rig.sensors}
        self._latest: dict[str, Frame] = {}
        (folder / "ids.json").write_text(self._ids.json())
        self._frames: _Frames = (
            _NpzFrames(folder / FRAMES_NAME["npz"], output.fields)
            if output.format == "npz"
            else ZarrStore(folder / "frames.zarr", rig.sensors, self._ids, output.fields)
        )

    def write(self, frame: Frame) -> None:
        """Append a frame. Raises OSError where it cannot be written."""
        require_room(self._folder, _ROOM + _PER_RAY * int(frame.range.size))
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
        self.close()
        if self._output.format == "zarr":
            _pack(self._folder / "frames.zarr", self._folder / FRAMES_NAME["zarr"])
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

    Where another worker has made the same in the meantime, that one stays: it is the same.
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
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        with suppress(OSError):  # others are at work
            temporary.parent.rmdir()


def sweep(folder: Path, names: Sequence[str]) -> None:
    """Remove what workers that were killed have left of these shards."""
    mine = {name.replace("/", "-") for name in names}
    unfinished = folder / UNFINISHED_NAME
    for path in unfinished.iterdir() if unfinished.is_dir() else ():
        if path.name.rpartition(".")[0] in mine:
            shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        unfinished.rmdir()


def model_digest(model: mujoco.MjModel) -> str:
    """SHA-256 of a compiled model, in hexadecimal."""
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return hashlib.sha256(buffer.tobytes()).hexdigest()


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
            # ZipInfo has a fixed date
            with self._file.open(
                zipfile.ZipInfo(f"{frame.sensor}/{number:06d}/{name}.npy"), "w", force_zip64=True
            ) as f:
                np.lib.format.write_array(f, np.asarray(field), allow_pickle=False)

    def close(self) -> None:
        self._file.close()


def _pack(store: Path, archive: Path) -> None:
    """A Zarr store as one file, as it is, and nothing left of its folder."""
    with zipfile.ZipFile(archive, "w") as file:
        for path in sorted(path for path in store.rglob("*") if path.is_file()):
            info = zipfile.ZipInfo(path.relative_to(store).as_posix())
            with file.open(info, "w", force_zip64=True) as target, path.open("rb") as source:
                shutil.copyfileobj(source, target)
    shutil.rmtree(store)


def _sealed(path: Path) -> dict[str, Any]:
    """Size and checksum of a file that is on the disk, not only on its way there."""
    with path.open("rb") as file:
        checksum = hashlib.file_digest(file, "sha256").hexdigest()
        os.fsync(file.fileno())
        return {"size": os.fstat(file.fileno()).st_size, "sha256": checksum}
