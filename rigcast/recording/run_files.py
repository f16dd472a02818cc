"""Recordings of whole runs: a Zarr store, ROS 2 bags. Each grows frame by frame in a folder of its own."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import mujoco

from rigcast.export.ids import IdTable
from rigcast.export.options import Export
from rigcast.export.zarr_store import ZarrStore
from rigcast.recording.formats import FORMATS
from rigcast.recording.layout import UNFINISHED_NAME
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.specs.sensor_spec import SensorSpec


class RunFile(Protocol):
    """A recording being written. Methods raise OSError on failure."""

    def step(self, data: mujoco.MjData | None, frames: Sequence[Frame]) -> None:
        """Append the frames of one step; data: the simulation after it, None if it is not known."""

    def close(self) -> None:
        """Complete what was written so far."""


class RunFiles:
    """The recordings of a run, of these formats; each gets its name in the run's folder when it is complete.

    paths: where they are when complete.
    """

    def __init__(
        self,
        folder: Path,
        formats: Sequence[str],
        model: mujoco.MjModel,
        sensors: Sequence[SensorSpec],
        ids: IdTable,
        options: Export,
    ) -> None:
        self.paths = [folder / FORMATS[name].suffixes[0] for name in formats]
        self._unfinished = folder / UNFINISHED_NAME
        if formats:
            self._unfinished.mkdir()
        self._open = {
            path: _begin(name, self._unfinished / path.name, model, sensors, ids, options)
            for name, path in zip(formats, self.paths, strict=True)
        }

    def step(self, data: mujoco.MjData | None, frames: Sequence[Frame]) -> None:
        """Append the frames of one step to each recording."""
        for recording in self._open.values():
            recording.step(data, frames)

    def finish(self) -> list[str]:
        """Complete all recordings; return the reasons for those that failed."""
        return [failure for path in list(self._open) if (failure := self._close(path))]

    def _close(self, path: Path) -> str | None:
        temporary = self._unfinished / path.name
        try:
            self._open.pop(path).close()
            temporary.rename(path)
            if not any(self._unfinished.iterdir()):
                self._unfinished.rmdir()
        except OSError as error:
            return f"{temporary}: cannot be completed: {error.strerror or error}"
        return None


def _begin(
    name: str, folder: Path, model: mujoco.MjModel, sensors: Sequence[SensorSpec], ids: IdTable, options: Export
) -> RunFile:
    """Begin a recording of format "zarr", "mcap" or "sqlite3" in a new `folder`."""
    if name == "zarr":
        return ZarrStore(folder, sensors, ids)
    from rigcast.ros.bag import BagRecorder  # imported here, because only bags need a Python with SQLite

    return BagRecorder(folder, "mcap" if name == "mcap" else "sqlite3", model, sensors, ids, options)
