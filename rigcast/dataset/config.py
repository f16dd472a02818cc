"""The file of a data set, read and checked at the door, and the episodes that it stands for."""

import hashlib
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from rigcast.export.fields import field_names
from rigcast.export.formats import FORMATS
from rigcast.rig_file import read_rig
from rigcast.rig_file.layers import read_layers
from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.faults import Fault, faults_of
from rigcast.sensors.names import expected_one_of

from .file import DatasetFile, RecordedMotion, SceneSource, UserController

_LOW, _HIGH = 0, 1
_TAKEN = ("failed", "unfinished")  # folders beside those of scenes


class Unit(NamedTuple):
    """One episode of one scene: what a worker makes by itself, into a shard of its own.

    number: of the episode within its scene. seed: all that happens in it follows from this.
    """

    scene: str
    number: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.scene}/{self.number:06d}"


@dataclass(frozen=True)
class DatasetConfig:
    """What the file of a data set says. folder: which its paths are relative to.

    sources: SHA-256 of the rig's files, the scenes' files, recorded motions and the modules of functions, by path.
    """

    path: Path
    folder: Path
    file: DatasetFile
    sources: dict[str, str]

    @property
    def rig(self) -> Path:
        return self.folder / self.file.rig

    def units(self) -> list[Unit]:
        """Every episode of every scene."""
        return [
            Unit(scene.name, number, _episode_seed(self.file.seed, scene.name, number))
            for scene in self.file.scenes
            for number in range(self.file.episodes.count)
        ]

    def scene(self, name: str) -> SceneSource:
        return next(scene for scene in self.file.scenes if scene.name == name)

    def call(self, name: str, *arguments: Any) -> Any:
        """What the user's `module:function` returns. Raises InputError for whatever it raises."""
        function = _function(self.folder, name)
        with blaming(name):
            return function(*arguments)

    def identity(self) -> dict[str, Any]:
        """What the frames of this data set follow from, as plain values.

        More episodes and other scenes may come later: those that there are stay as they are.
        """
        document = self.file.model_dump(mode="json")
        del document["episodes"]["count"], document["scenes"]
        scenes = {scene.name: scene.model_dump(mode="json") for scene in self.file.scenes}
        return {"config": document, "scenes": scenes, "sources": self.sources}

    def require_same_sources(self) -> None:
        """Raise InputError where a file has changed since the data set was read."""
        for name, expected in self.sources.items():
            if not (self.folder / name).is_file() or digest(self.folder / name) != expected:
                raise InputError(f"{self.folder / name} has changed since {self.path} was read")


def read_dataset(path: Path, overrides: Sequence[str] = ()) -> DatasetConfig:
    """Read and check the file of a data set, its rig, and the files and functions that it names.

    overrides: each `KEY=VALUE`, in place of what the file says.

    Raises InputError with every fault, each as `path:line:col: what is wrong` with the line below it. A scene that does
    not compile is none: its episodes fail, the others are made.
    """
    document = read_layers(path, overrides)
    try:
        file = DatasetFile.model_validate(document.content)
    except ValidationError as error:
        raise document.error(faults_of(error, DatasetFile)) from None
    folder = path.parent.resolve()  # workers may have other working directories
    faults = [*_name_faults(file), *_rig_faults(file, folder), *_scene_faults(file, folder)]
    faults += [*_controller_faults(file, folder), *_output_faults(file), *_field_faults(file, folder)]
    if faults:
        raise document.error(faults)
    return DatasetConfig(path, folder, file, _sources(file, folder))


def _episode_seed(seed: int, scene: str, number: int) -> int:
    """From 0 to 2^63 - 1; that of one episode depends on no other episode or scene."""
    digest = hashlib.blake2b(f"{seed}/{scene}/{number}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1


def _name_faults(file: DatasetFile) -> list[Fault]:
    counts = Counter(scene.name for scene in file.scenes)
    return [
        Fault(("scenes", i, "name"), f"{scene.name!r} is the name of something else too, expected another")
        for i, scene in enumerate(file.scenes)
        if counts[scene.name] > 1 or scene.name in _TAKEN
    ]


def _rig_faults(file: DatasetFile, folder: Path) -> list[Fault]:
    """A rig that is not there; one with faults of its own raises InputError that shows them in its file."""
    if not (folder / file.rig).is_file():
        return [Fault(("rig",), f"{folder / file.rig} is not a file")]
    read_rig(folder / file.rig)
    faults = []
    for end in (_LOW, _HIGH):
        try:
            read_rig(folder / file.rig, [f"{key}={ends[end]!r}" for key, ends in file.randomise.rig.items()])
        except InputError as error:
            faults.append(Fault(("randomise", "rig"), f"with the {('lowest', 'highest')[end]} values: {error}"))
    return faults


def _scene_faults(file: DatasetFile, folder: Path) -> list[Fault]:
    faults = []
    for i, scene in enumerate(file.scenes):
        if scene.file is not None and not (folder / scene.file).is_file():
            faults.append(Fault(("scenes", i, "file"), f"{folder / scene.file} is not a file"))
        if scene.python is not None:
            faults += _function_faults(("scenes", i, "python"), folder, scene.python)
    return faults


def _controller_faults(file: DatasetFile, folder: Path) -> list[Fault]:
    controller, where = file.episodes.controller, ("episodes", "controller")
    if isinstance(controller, UserController):
        return _function_faults((*where, "function"), folder, controller.function)
    if not isinstance(controller, RecordedMotion):
        return []
    try:
        rows = read_motion(folder / controller.file)
    except InputError as error:
        return [Fault((*where, "file"), str(error))]
    lasts = (len(rows) - 1) / controller.rate_hz
    if lasts < file.episodes.duration - 1e-9:
        return [Fault(("episodes", "duration"), f"got {file.episodes.duration:g} s, but the motion lasts {lasts:g} s")]
    return []


def _output_faults(file: DatasetFile) -> list[Fault]:
    if file.output.format != "zarr":
        return []
    try:
        load_extra("the format zarr", *(FORMATS["zarr"].needs or ("", "")))
    except InputError as error:
        return [Fault(("output", "format"), str(error))]
    return []


def _field_faults(file: DatasetFile, folder: Path) -> list[Fault]:
    if not (folder / file.rig).is_file():
        return []  # which is a fault of its own
    kinds = {spec.name: spec.type for spec in read_rig(folder / file.rig).sensors}
    faults = []
    for sensor, chosen in file.output.fields.items():
        where = ("output", "fields", sensor)
        if sensor not in kinds:
            faults.append(Fault(where, f"no sensor {sensor!r}, {expected_one_of(sensor, list(kinds))}", at_key=True))
            continue
        known = field_names(kinds[sensor])
        faults += [
            Fault((*where, i), f"no field {name!r} of a {kinds[sensor]}, {expected_one_of(name, known)}")
            for i, name in enumerate(chosen)
            if name not in known
        ]
    return faults


@contextmanager
def blaming(name: str) -> Iterator[None]:
    """Raise InputError in place of whatever a function of the user's raises, with its name."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{name}: {type(error).__name__}: {error}") from error


def _function_faults(where: tuple[str | int, ...], folder: Path, name: str) -> list[Fault]:
    try:
        _function(folder, name)
    except InputError as error:
        return [Fault(where, str(error))]
    return []


def read_motion(path: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(rows, nq) the positions in an NPY file. Raises InputError for anything else."""
    try:
        rows = np.asarray(np.load(path, allow_pickle=False), dtype=np.float64)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: not an NPY file of numbers: {error}") from None
    if rows.ndim != 2 or len(rows) < 2 or not np.isfinite(rows).all():
        raise InputError(f"{path}: got an array of shape {rows.shape}, expected 2 rows or more of nq finite numbers")
    return rows


def _function(folder: Path, name: str) -> Callable[..., Any]:
    module, _, attribute = name.partition(":")
    _find_modules_in(folder)
    try:
        function = getattr(import_module(module), attribute)
    except Exception as error:  # whatever the user's module does when it is imported
        raise InputError(f"{name} cannot be imported: {type(error).__name__}: {error}") from None
    if not callable(function):
        raise InputError(f"{name}: got {type(function).__name__}, expected a function")
    return function


def _find_modules_in(folder: Path) -> None:
    place = str(folder.resolve())
    if place not in sys.path:
        sys.path.insert(0, place)


def _sources(file: DatasetFile, folder: Path) -> dict[str, str]:
    rig = read_rig(folder / file.rig)
    paths = [*rig.files, *(prop.file for prop in rig.props)]
    paths += [folder / scene.file for scene in file.scenes if scene.file is not None]
    functions = [scene.python for scene in file.scenes if scene.python is not None]
    controller = file.episodes.controller
    if isinstance(controller, RecordedMotion):
        paths.append(folder / controller.file)
    if isinstance(controller, UserController):
        functions.append(controller.function)
    for name in functions:
        spec = find_spec(name.partition(":")[0])
        if spec is not None and spec.origin is not None:
            paths.append(Path(spec.origin))
    return {path: digest(folder / path) for path in sorted({_relative(path, folder) for path in paths})}


def _relative(path: Path, folder: Path) -> str:
    """A path as seen from the folder of the data set's file, the same wherever the whole is copied to."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
