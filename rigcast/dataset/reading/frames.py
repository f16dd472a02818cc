"""Reading of data sets: frames by number, arrays on access."""

import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import BadZipFile

from numpy.typing import NDArray

from rigcast.dataset.storage.manifest import MANIFEST_NAME, read_manifest, shard_name
from rigcast.dataset.storage.stores import Store, is_url, store_at
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.extras import load_extra
from rigcast.sensors.names import expected_one_of

from .archives import Archive, archive_of

if TYPE_CHECKING:
    from .in_torch import TorchFrames


class _Place(NamedTuple):
    """The place of a frame: shard, sensor, and number among that sensor's frames."""

    shard: int
    sensor: str
    number: int
    time: float


class StoredFrame(Mapping[str, NDArray[Any]]):
    """A frame of a data set: its arrays by name, read from the files at every access and not kept.

    sensor, time [s]: as in Frame. scene, episode, seed: what it was made from. `frame["range"]`, `frame["pose"]` and
    the other fields that were written have the shapes, units and miss values of Frame. Frames of depth cameras also
    have `intrinsics` (3, 3), `depth_scale` () and, with a lens, `distortion_model` () and `distortion`, in OpenCV's
    order.
    """

    def __init__(self, place: _Place, entry: Mapping[str, Any], archive: Archive) -> None:
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
        except BadZipFile as error:
            raise InputError(f"{self!r}: {name}: cannot be read: {error}; verify() names the file") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._archive.names(self.sensor, self._number))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __repr__(self) -> str:
        return f"<frame of {self.sensor!r} at {self.time:g} s in episode {self.episode} of {self.scene!r}>"


class Dataset(Sequence[StoredFrame]):
    """The frames of a data set, episode by episode, and within an episode ordered by time.

    manifest: the contents of dataset.json: statistics, provenance, previews, failed episodes. See `open_dataset`.
    """

    def __init__(self, store: Store, manifest: Mapping[str, Any], sensors: Sequence[str] | None = None) -> None:
        self.manifest, self._store = manifest, store
        self._shards: list[dict[str, Any]] = manifest["shards"]
        self._places = [place for k, entry in enumerate(self._shards) for place in _places(k, entry, sensors)]
        self._open: tuple[int, int, Archive] | None = None

    def __repr__(self) -> str:
        frames = Counter(place.sensor for place in self._places)
        return f"<data set of {', '.join(f'{n} frames of {name!r}' for name, n in frames.items()) or 'no frames'}>"

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: Any) -> Any:
        """One frame, or those of a slice as a list."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if isinstance(index, str):
            raise InputError(f"Dataset: got {index!r}, expected the number of a frame; of({index!r})[0] is the first")
        place = self._places[index]
        return StoredFrame(place, self._shards[place.shard], self._archive(place.shard))

    def of(self, *sensors: str) -> "Dataset":
        """The frames of these sensors only. Raises InputError for one that is not in the data set."""
        known = list(self.manifest["statistics"])
        for name in sensors:
            require_type("Dataset.of: name of a sensor", name, str)
            if name not in known:
                where = self._store.where(MANIFEST_NAME)
                raise InputError(f"{where}: no sensor {name!r}, {expected_one_of(name, known)}")
        return Dataset(self._store, self.manifest, sensors)

    def verify(self) -> list[str]:
        """A line for each file that is missing or differs from what was written."""
        faults = [fault for entry in self._shards for fault in _shard_faults(self._store, entry)]
        return faults + [fault for scene in self.manifest["scenes"] for fault in self._scene_faults(scene)]

    def torch(self, *fields: str) -> "TorchFrames":
        """A `torch.utils.data.Dataset` of {field: tensor}; to be batched, the frames must be of one sensor.

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

    def _archive(self, shard: int) -> Archive:
        """The shard's archive, kept open until another shard is accessed; a forked process opens it anew."""
        if self._open is None or self._open[:2] != (os.getpid(), shard):
            self._open = (os.getpid(), shard, archive_of(self._store, self._shards[shard]))
        return self._open[2]

    def _scene_faults(self, scene: str) -> list[str]:
        if self.manifest["scenes"][scene]["file"] is None:
            return []  # a function makes a different model for each episode
        digests = {entry["scene_sha256"] for entry in self._shards if entry["scene"] == scene}
        return [f"{scene}: its model changed while the data set was made"] if len(digests) > 1 else []


def open_dataset(path: str | Path, *, verify: bool = False) -> Dataset:
    """Open a data set: its frames by number, lazily loaded.

    Args:
        path: a folder, or a URL that fsspec knows, such as "s3://bucket/rooms". Only what you ask for is read, also
            from a URL: the manifest, then the shards' tables of contents and the arrays.
        verify: first compare every file with its checksum, which reads all of them.

    Raises:
        InputError: there is no data set, with `verify` a file differs from what was written, or a URL needs a library
            that is not installed.

    >>> frames = rigcast.open_dataset("out/rooms").of("top")
    >>> frames[0]["range"]  # float32 [m], +inf where nothing was hit
    """
    require_type("open_dataset: path", path, str, Path)
    if not is_url(path) and Path(path).is_file():
        raise InputError(f"{path}: a file, expected the folder of a data set")
    store = store_at(path)
    dataset = Dataset(store, read_manifest(store))
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


def _shard_faults(store: Store, entry: Mapping[str, Any]) -> Iterator[str]:
    for file_name, about in entry["files"].items():
        name = f"{shard_name(entry)}/{file_name}"
        try:
            with store.open(name) as file:
                found = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            yield f"{store.where(name)}: {'missing' if isinstance(error, FileNotFoundError) else error}"
            continue
        if found != about["sha256"]:
            yield f"{store.where(name)}: got another checksum than the manifest's, expected {about['sha256']}"
