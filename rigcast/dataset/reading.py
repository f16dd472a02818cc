"""Reading data sets: frames by their number, each array when it is asked for."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.names import expected_one_of

from .config import Unit, digest
from .manifest import read_manifest
from .shards import FRAMES_NAME

if TYPE_CHECKING:
    from .in_torch import TorchFrames


class _Place(NamedTuple):
    """Where a frame is: its shard, its sensor, its number among that sensor's."""

    shard: int
    sensor: str
    number: int
    time: float


class StoredFrame(Mapping[str, NDArray[Any]]):
    """A frame of a data set: its arrays by name, read when asked for and not kept.

    sensor, time [s]: as in Frame. scene, episode, seed: what it was made from. `frame["range"]`, `frame["pose"]` and
    whatever else of the frame was chosen, in the shapes, units and with the misses of Frame; of a depth camera also
    `intrinsics` (3, 3), `depth_scale` () and, with a lens, `distortion_model` () and `distortion`, OpenCV's order.
    """

    def __init__(self, place: _Place, entry: Mapping[str, Any], archive: "_Archive") -> None:
        self.sensor, self.time = place.sensor, place.time
        self.scene: str = entry["scene"]
        self.episode: int = entry["episode"]
        self.seed: int = entry["seed"]
        self._number, self._archive = place.number, archive

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self._archive.read(self.sensor, self._number, name)
        except KeyError:
            raise KeyError(f"{self!r} has no {name!r}, {expected_one_of(name, list(self))}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._archive.names(self.sensor, self._number))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __repr__(self) -> str:
        return f"<frame of {self.sensor!r} at {self.time:g} s in episode {self.episode} of {self.scene!r}>"


class Dataset(Sequence[StoredFrame]):
    """The frames of a data set, episode by episode and in each in the order of their times.

    manifest: what dataset.json says: statistics, provenance, previews, failed episodes. See `open_dataset`.
    """

    def __init__(self, folder: Path, manifest: Mapping[str, Any], sensors: Sequence[str] | None = None) -> None:
        self.folder, self.manifest = folder, manifest
        self._shards: list[dict[str, Any]] = manifest["shards"]
        self._places = [place for k, entry in enumerate(self._shards) for place in _places(k, entry, sensors)]
        self._open: tuple[int, int, _Archive] | None = None

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: Any) -> Any:
        """One frame, or those of a slice as a list."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        place = self._places[index]
        return StoredFrame(place, self._shards[place.shard], self._archive(place.shard))

    def of(self, *sensors: str) -> "Dataset":
        """The frames of these sensors only. Raises InputError for one that is not in the data set."""
        known = list(self.manifest["statistics"])
        for name in sensors:
            if name not in known:
                raise InputError(f"{self.folder}: no sensor {name!r}, {expected_one_of(name, known)}")
        return Dataset(self.folder, self.manifest, sensors)

    def verify(self) -> list[str]:
        """What is wrong with the files, a line for each: those that are missing, or are not as they were written."""
        faults = [fault for entry in self._shards for fault in _shard_faults(self.folder, entry)]
        return faults + [fault for scene in self.manifest["scenes"] for fault in self._scene_faults(scene)]

    def torch(self, *fields: str) -> "TorchFrames":
        """A `torch.utils.data.Dataset` of {field: tensor}; the frames should be of one sensor to be batched.

        Raises InputError where torch is not installed, or the first frame has no such field.

        >>> frames = rigcast.open_dataset("out/rooms").of("top").torch("range", "pose")
        >>> loader = torch.utils.data.DataLoader(frames, batch_size=32, shuffle=True)
        """
        for name in fields if len(self) else ():
            if name not in self[0]:
                raise InputError(f"Dataset.torch: {self[0]!r} has no {name!r}, {expected_one_of(name, list(self[0]))}")
        load_extra("Dataset.torch", "torch", "torch")
        from .in_torch import TorchFrames

        return TorchFrames(self, fields)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_open": None}

    def _archive(self, shard: int) -> "_Archive":
        """The shard, kept open until a frame of another is asked for; a forked process opens it anew."""
        if self._open is None or self._open[:2] != (os.getpid(), shard):
            self._open = (os.getpid(), shard, _archive_of(self.folder, self._shards[shard]))
        return self._open[2]

    def _scene_faults(self, scene: str) -> list[str]:
        if self.manifest["scenes"][scene]["file"] is None:
            return []  # a function makes another model for each episode
        digests = {entry["scene_sha256"] for entry in self._shards if entry["scene"] == scene}
        return [f"{scene}: its model changed while the data set was made"] if len(digests) > 1 else []


def open_dataset(path: str | Path, *, verify: bool = False) -> Dataset:
    """Open the data set in a folder: its frames by number, lazily loaded.

    verify: compare every file with its checksum first.

    Raises:
        InputError: there is no data set, or with `verify` a file is not as it was written.

    >>> frames = rigcast.open_dataset("out/rooms").of("top")
    >>> frames[0]["range"]  # float32 [m], +inf where nothing was hit
    """
    folder = Path(path)
    dataset = Dataset(folder, read_manifest(folder))
    faults = dataset.verify() if verify else []
    if faults:
        raise InputError("\n".join(faults))
    return dataset


def _places(shard: int, entry: Mapping[str, Any], sensors: Sequence[str] | None) -> list[_Place]:
    places = [
        _Place(shard, name, number, time)
        for name, sensor in entry["sensors"].items()
        if sensors is None or name in sensors
        for number, time in enumerate(sensor["times"])
    ]
    return sorted(places, key=lambda place: place.time)


def _shard_folder(folder: Path, entry: Mapping[str, Any]) -> Path:
    return folder / Unit(entry["scene"], entry["episode"], entry["seed"]).name


def _shard_faults(folder: Path, entry: Mapping[str, Any]) -> Iterator[str]:
    for name, about in entry["files"].items():
        path = _shard_folder(folder, entry) / name
        if not path.is_file():
            yield f"{path}: missing"
        elif digest(path) != about["sha256"]:
            yield f"{path}: got another checksum than the manifest's, expected {about['sha256']}"


class _Archive(Protocol):
    """The arrays of one shard."""

    def read(self, sensor: str, number: int, name: str) -> NDArray[Any]:
        """One array. Raises KeyError where the frame has none of that name."""

    def names(self, sensor: str, number: int) -> Iterable[str]:
        """Those that a frame has."""


class _NpzArchive:
    def __init__(self, path: Path) -> None:
        self._file = np.load(path, allow_pickle=False)

    def read(self, sensor: str, number: int, name: str) -> NDArray[Any]:
        return self._file[f"{sensor}/{number:06d}/{name}"]

    def names(self, sensor: str, number: int) -> Iterable[str]:
        prefix = f"{sensor}/{number:06d}/"
        return [name.removeprefix(prefix) for name in self._file.files if name.startswith(prefix)]


class _ZarrArchive:
    def __init__(self, path: Path) -> None:
        zarr: Any = load_extra("a data set of format zarr", "zarr", "zarr")
        self._root = zarr.open_group(zarr.storage.ZipStore(path, mode="r"), mode="r")

    def read(self, sensor: str, number: int, name: str) -> NDArray[Any]:
        group = self._root[sensor]
        return np.array(group.attrs[name]) if name in group.attrs else group[name][number]

    def names(self, sensor: str, _number: int) -> Iterable[str]:
        group = self._root[sensor]
        return [*group.array_keys(), *(name for name in group.attrs if name not in ("type", "spec"))]


def _archive_of(folder: Path, entry: Mapping[str, Any]) -> _Archive:
    kinds: dict[str, Callable[[Path], _Archive]] = {"npz": _NpzArchive, "zarr": _ZarrArchive}
    (form,) = [name for name, file in FRAMES_NAME.items() if file in entry["files"]]
    return kinds[form](_shard_folder(folder, entry) / FRAMES_NAME[form])
