"""Generation of the missing episodes of a data set by an engine; finished episodes survive any interruption."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from rigcast.dataset.description.config import DatasetConfig, Unit
from rigcast.dataset.storage.manifest import begin, is_finished, note_failure, write_manifest
from rigcast.dataset.storage.shards import sweep
from rigcast.motion.simulation import Spent
from rigcast.sensors.errors import InputError

from .engines import Engine
from .environment import environment, prepare_warp
from .episode import Job, Result, make_episode


@dataclass
class Done:
    """Totals of one call: episodes, frames and bytes, wall-clock seconds, and the workers' seconds by purpose."""

    episodes: int = 0
    frames: int = 0
    size: int = 0
    seconds: float = 0.0
    spent: Spent = field(default_factory=Spent)
    manifest: dict[str, Any] = field(default_factory=dict)

    def add(self, result: Result) -> None:
        self.episodes += result.failed is None
        self.frames += result.frames
        self.size += result.size
        self.spent.add(result.spent)


def missing_units(config: DatasetConfig, folder: Path, part: tuple[int, int]) -> list[Unit]:
    """The episodes in part (i, n) that have no shard yet."""
    i, n = part
    return [unit for unit in config.units()[i - 1 :: n] if not is_finished(folder, unit)]


def make_dataset(
    config: DatasetConfig,
    folder: Path,
    engine: Engine,
    *,
    device: str | None,
    part: tuple[int, int] = (1, 1),
    report: Callable[[Result], None] = lambda _result: None,
) -> Done:
    """Make every episode that has no shard in `folder` yet, and write the manifest.

    part: (i, n), only every n-th episode from the i-th on, for jobs that share a folder. report: called with each
    result as it comes.

    Raises:
        InputError: the folder holds another data set, or cannot be written, as when the disk is full. Shards that
            are finished stay, and the same call goes on from there.
    """
    prepare_warp(config.file.portable)
    made_with = environment(config.file, device)
    begin(config, folder, made_with)
    units = missing_units(config, folder, part)
    sweep(folder, [unit.name for unit in units])  # frees space on a full disk
    done, began = Done(), perf_counter()
    results = engine.run(partial(make_episode, Job(config, folder, device, made_with)), units)
    try:
        for result in results:
            if result.stops:
                raise InputError(f"{result.failed}; finished episodes are kept; run the same command again to continue")
            note_failure(folder, result.unit, result.failed)
            done.add(result)
            report(result)
    except BaseException:
        results.close()
        sweep(folder, [unit.name for unit in units])
        with suppress(InputError):  # on a full disk the manifest stays as it was; the next call updates it
            write_manifest(config, folder, made_with)
        raise
    sweep(folder, [unit.name for unit in units])
    done.seconds = perf_counter() - began
    done.manifest = write_manifest(config, folder, made_with)
    return done
