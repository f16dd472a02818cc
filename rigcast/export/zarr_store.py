"""frames.zarr: the frames of a run as arrays that grow, for long recordings.

A group per sensor, with one row, and one chunk, per frame: `time` (F,) float64 [s], `pose` (F, 4, 4) float64, sensor
in world, and every per-ray field of the frame (F, ...), misses included, as Frame has them. Attributes of a group:
`type`, `spec` (JSON), `intrinsics` of a camera; of the root: `ids`, the columns of `IdTable`.
After a crash some rows at the end are empty: those whose `time` is NaN. It is written last, so all others are whole.
"""

import json
import operator
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.export.fields import fields_of
from rigcast.export.ids import IdTable
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.specs.sensor_spec import SensorSpec

_BLOCK = 256  # rows that arrays grow by; each time costs as much as writing a frame


class ZarrStore:
    """A Zarr store (format 3) that is being written. Raises OSError where it cannot be."""

    def __init__(self, folder: Path, sensors: Sequence[SensorSpec], ids: IdTable) -> None:
        import zarr

        self._root = zarr.create_group(store=str(folder), zarr_format=3, attributes={"ids": ids.lists()})
        self._groups: dict[str, Any] = {}
        self._arrays: dict[str, dict[str, Any]] = {}
        self._frames = dict.fromkeys((spec.name for spec in sensors), 0)
        self._pool = ThreadPoolExecutor(4)
        for spec in sensors:
            about = {"type": spec.type, "spec": json.dumps(spec.model_dump(mode="json"))}
            self._groups[spec.name] = self._root.create_group(spec.name, attributes=about)

    def step(self, _data: mujoco.MjData | None, frames: Sequence[Frame]) -> None:
        """Append frames."""
        for frame in frames:
            self.write(frame)

    def write(self, frame: Frame) -> None:
        """Append one frame. Raises InputError for one of other fields or shapes than its sensor's first."""
        rows = {"pose": np.asarray(frame.pose), **fields_of(frame)}
        if frame.sensor not in self._arrays:
            self._arrays[frame.sensor] = self._create(frame, rows)
        arrays, number = self._arrays[frame.sensor], self._frames[frame.sensor]
        _require_shapes(frame.sensor, rows, arrays)
        if number % _BLOCK == 0:
            self._resize(frame.sensor, number + _BLOCK)
        # most of a small write's time is waiting within zarr, so the fields wait side by side
        list(self._pool.map(lambda name: operator.setitem(arrays[name], number, rows[name]), rows))
        arrays["time"][number] = frame.time
        self._frames[frame.sensor] += 1

    def close(self) -> None:
        """Cut off the rows that were not filled."""
        for name in self._arrays:
            self._resize(name, self._frames[name])
        self._pool.shutdown()

    def _resize(self, sensor: str, count: int) -> None:
        for array in self._arrays[sensor].values():
            array.resize((count, *array.shape[1:]))

    def _create(self, frame: Frame, rows: dict[str, NDArray[Any]]) -> dict[str, Any]:
        group = self._groups[frame.sensor]
        if isinstance(frame, CameraFrame):
            group.attrs["intrinsics"] = frame.intrinsics.tolist()
        times = group.create_array("time", shape=(0,), chunks=(1,), dtype=np.float64, fill_value=np.nan)
        return {"time": times} | {
            name: group.create_array(name, shape=(0, *row.shape), chunks=(1, *row.shape), dtype=row.dtype)
            for name, row in rows.items()
        }


def _require_shapes(sensor: str, rows: dict[str, NDArray[Any]], arrays: dict[str, Any]) -> None:
    got = {name: row.shape for name, row in rows.items()}
    expected = {name: array.shape[1:] for name, array in arrays.items() if name != "time"}
    if got != expected:
        raise InputError(f"zarr: sensor {sensor!r}: got a frame of {got}, expected {expected} like its first")
