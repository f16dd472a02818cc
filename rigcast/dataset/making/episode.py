"""The work of any engine's worker: one episode, from its seed to its shard."""

import copy
import hashlib
import platform
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from rigcast.dataset.description.config import DatasetConfig, Unit
from rigcast.dataset.storage.shards import Shard, appearing
from rigcast.motion.simulation import Spent, initial_data, step_count
from rigcast.rig_file import compile_model, open_rig
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.rig import Rig

from .controllers import stepper
from .environment import environment, prepare_warp
from .randomise import draw_poses, draw_rig, place_bodies


@dataclass(frozen=True)
class Job:
    """Data shared by all episodes of a data set. made_with: `environment` of the machine where the job began."""

    config: DatasetConfig
    folder: Path
    device: str | None
    made_with: dict[str, str]


@dataclass(frozen=True)
class Result:
    """The outcome of an episode.

    failed: the reason why there is no shard; None if there is one. stops: whether others would fail likewise.
    """

    unit: Unit
    failed: str | None = None
    stops: bool = False
    frames: int = 0
    size: int = 0
    spent: Spent = field(default_factory=Spent)


def make_episode(job: Job, unit: Unit) -> Result:
    """Run one episode and write its shard; any failure is reported in the result."""
    try:
        prepare_warp(job.config.file.portable)
        _require_same_environment(job)
        job.config.require_same_sources()
    except (InputError, OSError) as error:
        return Result(unit, f"{platform.node()}: {error}", stops=True)
    try:
        return _made(job, unit)
    except OSError as error:
        return Result(unit, f"{job.folder} cannot be written: {error.strerror or error}", stops=True)
    except Exception as error:
        return Result(unit, reason_of(error))


def reason_of(error: Exception) -> str:
    """The reason why an episode fails, as text."""
    return str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"


def _made(job: Job, unit: Unit) -> Result:
    spent = Spent()
    with spent.on("loading"):
        episode = open_episode(job.config, unit, job.device)
    first = unit.episode == 0
    with appearing(job.folder, unit.name) as folder:
        shard = Shard(folder, episode.rig, episode.classes, job.config.file.output, pictured=first)
        try:
            _simulate(episode, shard, spent)
            with spent.on("writing"):
                entry = shard.finish(episode.about)
        except BaseException:
            shard.close()
            raise
    frames = sum(sensor["frames"] for sensor in entry["sensors"].values())
    return Result(unit, frames=frames, size=sum(file["size"] for file in entry["files"].values()), spent=spent)


@dataclass(frozen=True)
class Episode:
    """An episode about to begin. step: advances `data` by one timestep. about: its provenance, as plain values."""

    rig: Rig
    data: mujoco.MjData
    steps: int
    step: Callable[[], None]
    classes: Any
    about: dict[str, Any]


def open_episode(config: DatasetConfig, unit: Unit, device: str | None) -> Episode:
    """The model, rig and initial state of an episode, with all of its random draws.

    Raises InputError if the scene does not compile or does not fit the rig.
    """
    file = config.file
    model = _compile(config, unit)
    scene_hash = _model_digest(model)
    values, poses = draw_rig(file.randomise, unit.seed), draw_poses(file.randomise, unit.seed)
    rig_config, _ = open_rig(config.rig, model, [f"{key}={value!r}" for key, value in values.items()])
    data = initial_data(model, rig_config.keyframe)
    place_bodies(model, data, poses)
    rig = rig_config.build(model, device, unit.seed)
    about = {**unit._asdict(), "scene_sha256": scene_hash, "rig": values, "poses": poses}
    step = stepper(config, model, data, unit.seed, poses)
    return Episode(rig, data, step_count(model, file.episodes.duration), step, rig_config.classes, about)


def _simulate(episode: Episode, shard: Shard, spent: Spent) -> None:
    for _ in range(episode.steps):
        with spent.on("physics"):
            episode.step()
        with spent.on("casting"):
            frames = episode.rig.step(episode.data)
        with spent.on("writing"):
            for frame in frames:
                shard.write(frame)


def _compile(config: DatasetConfig, unit: Unit) -> mujoco.MjModel:
    scene = config.scene(unit.scene)
    if scene.file is not None:
        return compile_model(config.folder / scene.file)
    assert scene.python is not None
    function = config.function(scene.python)
    model = function(unit.seed)
    if not isinstance(model, mujoco.MjModel):
        raise function.wrong(f"got {type(model).__name__}, expected an MjModel")
    return copy.copy(model)  # a copy, because bodies are moved in it and the function may return it again


def _model_digest(model: mujoco.MjModel) -> str:
    """SHA-256 of a compiled model, in hexadecimal."""
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return hashlib.sha256(buffer.tobytes()).hexdigest()


def _require_same_environment(job: Job) -> None:
    here = environment(job.config.file, job.device)
    other = [f"{key} {here.get(key)} for {value}" for key, value in job.made_with.items() if here.get(key) != value]
    if other:
        raise InputError(f"this machine is of another kind than where the job began: got {', '.join(other)}")
