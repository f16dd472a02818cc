"""Readings in the folder of `rigcast run`."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from trimesh.exchange.ply import load_ply

from rigcast.dataset.storage.manifest import MANIFEST_NAME
from rigcast.dataset.storage.shards import ENTRY_NAME
from rigcast.recording.index import read_journal
from rigcast.recording.layout import INDEX_NAME, JOURNAL_NAME
from rigcast.sensors.errors import InputError
from rigcast.sensors.names import listing
from rigcast.sensors.specs.lens import BrownConrady, KannalaBrandt, Lens
from rigcast.view.bag import is_bag, read_bag
from rigcast.view.shots import VALUES, Share, Shot, arrays_of_image

_READABLE = ("npz", "exr", "ply")
_UNREADABLE = (OSError, ValueError, EOFError, BadZipFile)
_EXPECTED = "expected a folder of rigcast run, or a ROS bag"


def read_run(folder: Path, most: int | None = None) -> Iterator[Shot]:
    """The readings that were written as npz, exr or ply, else those in a bag, in the order of their times.

    For a run that is under way or was killed, those written so far.

    most: no more than that, the same share of every sensor's. One is read at a time.

    Raises InputError for a folder without frames.npz, or without a frame in one of these formats.
    """
    index = _read_index(folder)
    columns = [index[name] for name in _READABLE if name in index]
    files = [next((column[i] for column in columns if column[i]), "") for i in range(len(index["sensor"]))]
    if not any(files):
        yield from read_bag(_bag_in(folder), most)
        return
    rows = [i for i in np.argsort(index["time"], kind="stable") if files[i]]
    share = Share(list(Counter(index["sensor"][rows]).values()), most)
    for i in rows:
        sensor = str(index["sensor"][i])
        if share.takes(sensor):
            yield Shot.of(sensor, float(index["time"][i]), index["pose"][i], _read(folder / files[i]))


def _read_index(folder: Path) -> dict[str, NDArray[Any]]:
    if any((folder / name).is_file() for name in (MANIFEST_NAME, ENTRY_NAME)):
        raise InputError(f"{folder}: a data set, or an episode of one, which rigcast.open_dataset reads; {_EXPECTED}")
    try:
        if (folder / JOURNAL_NAME).is_file():
            return read_journal(folder / JOURNAL_NAME, _READABLE)
        return _arrays(folder / INDEX_NAME)
    except _UNREADABLE as error:
        reason = getattr(error, "strerror", None) or error
        below = [str(index.parent) for index in sorted(folder.glob(f"*/{INDEX_NAME}"))]
        there = f"; such folders are {listing(below)}" if below else ""
        raise InputError(f"{folder / INDEX_NAME}: cannot be read: {reason}; {_EXPECTED}{there}") from None


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    with path.open("rb") as file, np.load(file) as archive:  # numpy leaves files open that it cannot read
        return {name: archive[name] for name in archive.files}


def _bag_in(folder: Path) -> Path:
    for path in sorted(folder.iterdir()):
        if is_bag(path):
            return path
    raise InputError(f"{folder}: no frame in any of {', '.join(_READABLE)}, and no bag, of which a view is made")


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.suffix == ".npz":
            return _arrays(path)
        return _read_exr(path) if path.suffix == ".exr" else _read_ply(path)
    except (*_UNREADABLE, RuntimeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error


def _read_exr(path: Path) -> dict[str, Any]:
    image = OpenEXR.File(str(path), separate_channels=True)
    channels = {name: channel.pixels for name, channel in image.channels().items()}
    header = image.header()
    return {**arrays_of_image(channels["Z"], header["intrinsics"], _lens(header)), **channels}


def _lens(header: dict[str, Any]) -> Lens | None:
    kinds: dict[str, type[Lens]] = {"brown_conrady": BrownConrady, "kannala_brandt": KannalaBrandt}
    kind = kinds.get(header.get("distortion_model", ""))
    prefix = "distortion_k", "distortion_p"
    named = {name.removeprefix("distortion_"): float(header[name][0]) for name in header if name.startswith(prefix)}
    return None if kind is None else kind.model_validate(named)


def _read_ply(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        rows = load_ply(file)["metadata"]["_ply_raw"]["vertex"]["data"]  # a cloud without points has no vertices
    points = np.stack([rows[axis].reshape(-1) for axis in "xyz"], axis=-1).astype(np.float32)
    arrays = {name: rows[name].reshape(-1) for name in VALUES if name in (rows.dtype.names or ())}
    return {"points": points, "range": np.linalg.norm(points, axis=-1), **arrays}
