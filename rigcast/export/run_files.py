"""What holds a whole run: a Zarr store, ROS 2 bags. Each grows frame by frame in a folder of its own."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import mujoco

from rigcast.export.ids import IdTable
from rigcast.export.options import Export
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.specs.sensor_spec import SensorSpec


class RunFile(Protocol):
    """A recording that is being written. Methods raise OSError where that fails."""

    def step(self, data: mujoco.MjData | None, frames: Sequence[Frame]) -> None:
        """Append the frames of one step; data: the simulation after it, None if it is not known."""

    def close(self) -> None:
        """Complete what was written so far."""


def open_run_file(
    name: str, folder: Path, model: mujoco.MjModel, sensors: Sequence[SensorSpec], ids: IdTable, options: Export
) -> RunFile:
    """A new recording in `folder`, of format "zarr", "mcap" or "sqlite3"."""
    if name == "zarr":
        from rigcast.export.zarr_store import ZarrStore

        return ZarrStore(folder, sensors, ids)
    from rigcast.ros.bag import BagRecorder

    return BagRecorder(folder, "mcap" if name == "mcap" else "sqlite3", model, sensors, ids, options)
