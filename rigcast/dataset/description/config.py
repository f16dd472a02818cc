"""The file of a data set, read and checked, and the episodes that it describes."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from rigcast.motion.functions import UserFunction, find_function, module_file
from rigcast.rig_file import read_rig
from rigcast.rig_file.layers import read_layers
from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import faults_of
from rigcast.sensors.yaml.kinds import other_kind

from .faults import faults_in
from .file import DatasetFile, RecordedMotion, SceneSource, UserController


class Unit(NamedTuple):
    """One episode of one scene, which one worker makes as one shard.

    episode: its number within its scene. seed: determines everything that happens in it.
    """

    scene: str
    episode: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.scene}/{self.episode:06d}"


@dataclass(frozen=True)
class DatasetConfig:
    """The contents of a data set's file. folder: its paths are relative to this folder.

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
            self.unit(scene.name, episode) for scene in self.file.scenes for episode in range(self.file.episodes.count)
        ]

    def unit(self, scene: str, episode: int) -> Unit:
        return Unit(scene, episode, _episode_seed(self.file.seed, scene, episode))

    def scene(self, name: str) -> SceneSource:
        return next(scene for scene in self.file.scenes if scene.name == name)

    def function(self, name: str) -> UserFunction:
        """The user's `module:function` of this name."""
        return find_function(self.folder, name)

    def identity(self) -> dict[str, Any]:
        """Everything that the frames of this data set depend on, as plain values.

        Episodes and scenes may be added later without a change of the existing ones.
        """
        document = self.file.model_dump(mode="json")
        del document["episodes"]["count"], document["scenes"]
        scenes = {scene.name: scene.model_dump(mode="json") for scene in self.file.scenes}
        return {"config": document, "scenes": scenes, "sources": self.sources}

    def require_same_sources(self) -> None:
        """Raise InputError if a file has changed since the data set was read."""
        for name, expected in self.sources.items():
            if not (self.folder / name).is_file() or digest(self.folder / name) != expected:
                raise InputError(f"{self.folder / name} has changed since {self.path} was read")


def read_dataset(path: Path, overrides: Sequence[str] = ()) -> DatasetConfig:
    """Read and check the file of a data set, its rig, and the files and functions that it names.

    overrides: each `KEY=VALUE`, replacing the file's value.

    Raises InputError with every fault, each as `path:line:col: message` with the line below it. A scene that does
    not compile is not a fault: its episodes fail, the others are made.
    """
    document = read_layers(path, overrides)
    other = other_kind(document, "data set")
    if other:
        raise document.error(other)
    try:
        file = DatasetFile.model_validate(document.content)
    except ValidationError as error:
        raise document.error(faults_of(error, DatasetFile)) from None
    folder = path.parent.resolve()  # absolute, because workers may have other working directories
    faults = faults_in(file, folder)
    if faults:
        raise document.error(faults)
    return DatasetConfig(path, folder, file, _sources(file, folder))


def _episode_seed(seed: int, scene: str, episode: int) -> int:
    """The seed of an episode, 0 to 2^63 - 1; it does not depend on other episodes or scenes."""
    digest = hashlib.blake2b(f"{seed}/{scene}/{episode}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1


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
    paths += [path for path in map(module_file, functions) if path is not None]
    return {path: digest(folder / path) for path in sorted({_relative(path, folder) for path in paths})}


def _relative(path: Path, folder: Path) -> str:
    """A path relative to the folder of the data set's file, which stays the same if everything is copied elsewhere."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
