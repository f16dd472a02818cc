"""Reading of data sets: frames by number, arrays on access."""

import hashlib
import os
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from rigcast.dataset.storage.manifest import MANIFEST_NAME, read_manifest, shard_name
from rigcast.dataset.storage.stores import Store, is_url, store_at
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.extras import load_extra
from rigcast.sensors.names import expected_one_of

from .archives import StoredShard

if TYPE_CHECKING:
    from .in_torch import TorchFrames


_CLASS_ID = "class_id"  # not written: it follows from the ids and ids.json


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
    order. Frames with `geom_id` also have `class_id`, int32 of the same shape: the class of what was hit, a row of
    `names["class_name"]`, 0 for none and for a miss.
    """

    def __init__(self, place: _Place, shard: StoredShard) -> None:
        self.sensor, self.time = place.sensor, place.time
        self.scene: str = shard.entry["scene"]
        self.episode: int = shard.entry["episode"]
        self.seed: int = shard.entry["seed"]
        self._number, self._shard = place.number, shard

    @property
    def names(self) -> dict[str, list[str] | list[int]]:
        """The meaning of ids, the contents of ids.json: `class_name`, `geom_name`, `geom_class`, `body_name`..."""
        return self._shard.ids.lists()

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self._class_id() if name == _CLASS_ID else self._read(name)
        except KeyError:
            raise KeyError(f"{self!r} has no {name!r}, {expected_one_of(name, list(self))}") from None
        except BadZipFile as error:
            raise InputError(f"{self!r}: {name}: cannot be read: {error}; verify() names the file") from None

    def __iter__(self) -> Iterator[str]:
        names = list(self._shard.archive.names(self.sensor, self._number))
        return iter(sorted([*names, _CLASS_ID]) if "geom_id" in names else names)

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __repr__(self) -> str:
        return f"<frame of {self.sensor!r} at {self.time:g} s in episode {self.episode} of {self.scene!r}>"

    def _read(self, name: str) -> NDArray[Any]:
        return self._shard.archive.read(self.sensor, self._number, name)

    def _class_id(self) -> NDArray[np.int32]:
        ids = {name: self._read(name) for name in self if name in ("geom_id", "flex_id", "skin_id", "prop_id")}
        return self._shard.ids.class_of(ids)


class Dataset(Sequence[StoredFrame]):
    """The frames of a data set, episode by episode, and within an episode ordered by time.

    manifest: the contents of dataset.json: statistics, provenance, previews, failed episodes. See `open_dataset`.
    """

    def __init__(self, store: Store, manifest: Mapping[str, Any]) -> None:
        self.manifest, self._store = manifest, store
        self._entries: list[dict[str, Any]] = manifest["shards"]
        self._places = [place for k, entry in enumerate(self._entries) for place in _places(k, entry)]
        self._open: tuple[int, int, StoredShard] | None = None

    def __repr__(self) -> str:
        frames = Counter(place.sensor for place in self._places)
        return f"<data set of {', '.join(f'{n} frames of {name!r}' for name, n in frames.items()) or 'no frames'}>"

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, number: Any) -> Any:
        """One frame, or those of a slice as a list."""
        if isinstance(number, slice):
            return [self[i] for i in range(*number.indices(len(self)))]
        if isinstance(number, str):
            raise InputError(f"Dataset: got {number!r}, expected the number of a frame; of({number!r})[0] is the first")
        place = self._places[number]
        return StoredFrame(place, self._shard(place.shard))

    def of(
        self, *sensors: str, scenes: Collection[str] | None = None, episodes: Iterable[int] | None = None
    ) -> "Dataset":
        """Of these frames those of some sensors, scenes and episodes; all where none are given.

        Episodes of a scene are independent of each other, so a split is a choice of their numbers. Those that the data
        set does not have, perhaps because they failed, give no frames.

        Raises InputError for a sensor or scene that is not in the data set, or numbers that are not whole.

        >>> train = rigcast.open_dataset("out/rooms").of("top", episodes=range(80))
        """
        self._require_known("sensor", sensors, list(self.manifest["statistics"]))
        if isinstance(scenes, str):
            raise InputError(f"Dataset.of: scenes: got {scenes!r}, expected a list of names, such as [{scenes!r}]")
        self._require_known("scene", () if scenes is None else scenes, list(self.manifest["scenes"]))
        numbers = None if episodes is None else _episode_numbers(episodes)
        chosen = copy(self)
        chosen._places = [
            place
            for place in self._places
            if (not sensors or place.sensor in sensors)
            and (scenes is None or self._entries[place.shard]["scene"] in scenes)
            and (numbers is None or self._entries[place.shard]["episode"] in numbers)
        ]
        return chosen

    def verify(self) -> list[str]:
        """A line for each file that is missing or differs from what was written."""
        faults = [fault for entry in self._entries for fault in _shard_faults(self._store, entry)]
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

    def _shard(self, number: int) -> StoredShard:
        """A shard, kept open until another one is accessed; a forked process opens it anew."""
        if self._open is None or self._open[:2] != (os.getpid(), number):
            self._open = (os.getpid(), number, StoredShard(self._store, self._entries[number]))
        return self._open[2]

    def _require_known(self, kind: str, names: Collection[str], known: list[str]) -> None:
        for name in names:
            require_type(f"Dataset.of: name of a {kind}", name, str)
            if name not in known:
                where = self._store.where(MANIFEST_NAME)
                raise InputError(f"{where}: no {kind} {name!r}, {expected_one_of(name, known)}")

    def _scene_faults(self, scene: str) -> list[str]:
        if self.manifest["scenes"][scene]["file"] is None:
            return []  # a function makes a different model for each episode
        digests = {entry["scene_sha256"] for entry in self._entries if entry["scene"] == scene}
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


def _places(shard: int, entry: Mapping[str, Any]) -> list[_Place]:
    places = [
        _Place(shard, name, number, time)
        for name, sensor in entry["sensors"].items()
        for number, time in enumerate(sensor["times"])
    ]
    return sorted(places, key=lambda place: place.time)


def _episode_numbers(episodes: Iterable[int]) -> frozenset[int]:
    try:
        return frozenset(map(index, episodes))
    except TypeError:
        expected = "expected their numbers, such as range(80) or [0, 2]"
        raise InputError(f"Dataset.of: episodes: got {episodes!r:.80}, {expected}") from None


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
