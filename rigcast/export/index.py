"""frames.npz: what a run wrote, one row per frame, with the sensors and the names behind the ids.

Frames, F rows in the order written: `sensor` (F,) str, `frame` (F,) int64, its number within that sensor,
`time` (F,) float64 [s], `pose` (F, 4, 4) float64, sensor in world, and for each format of the run (`exr`,
`ply`, `npz`) the file (F,) str, relative to the folder of frames.npz, "" where that sensor is not written so.
Sensors, S rows in the order of the rig: `sensor_name`, `sensor_type` (S,) str, `sensor_shape` (S, 2) int64,
the last 0 where rays have one axis only, `sensor_intrinsics` (S, 3, 3) float64, NaN unless a camera,
`sensor_distortion_model` (S,) str, "" without a lens, `sensor_distortion` (S, 8) float64, its coefficients in OpenCV's
order, then NaN,
`sensor_spec` (S,) str, JSON of everything the rig says about it, with Infinity as Python writes and reads it.
Ids: `geom_name`, `geom_body`, `body_name` of `IdTable`.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcast.export.ids import IdTable
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.specs.lens import Lens
from rigcast.sensors.specs.pattern import Pattern
from rigcast.sensors.specs.sensor_spec import SensorSpec


class FrameIndex:
    """The rows of frames.npz, gathered while a run writes its frames."""

    def __init__(
        self,
        sensors: Sequence[SensorSpec],
        patterns: Mapping[str, Pattern],
        formats: Sequence[str],
        ids: IdTable,
    ) -> None:
        self._fixed = _sensor_table(sensors, patterns) | vars(ids)
        self._sensor: list[str] = []
        self._frame: list[int] = []
        self._time: list[float] = []
        self._pose: list[NDArray[np.float64]] = []
        self._files: dict[str, list[str]] = {name: [] for name in formats}

    def __len__(self) -> int:
        return len(self._sensor)

    def add(self, frame: Frame, number: int, files: Mapping[str, str]) -> None:
        """Append a frame; `files` maps format to path relative to the run's folder."""
        self._sensor.append(frame.sensor)
        self._frame.append(number)
        self._time.append(frame.time)
        self._pose.append(np.array(frame.pose, dtype=np.float64))
        for name, column in self._files.items():
            column.append(files.get(name, ""))

    def write(self, path: Path) -> None:
        """Write the rows so far to `path`, whatever its suffix. Raises OSError where it cannot be written."""
        columns: dict[str, Any] = {
            "sensor": np.array(self._sensor, dtype=np.str_),
            "frame": np.array(self._frame, dtype=np.int64),
            "time": np.array(self._time, dtype=np.float64),
            "pose": np.array(self._pose, dtype=np.float64).reshape(-1, 4, 4),
        }
        columns |= {name: np.array(files, dtype=np.str_) for name, files in self._files.items()}
        with path.open("wb") as file:
            np.savez(file, **columns, **self._fixed)


def _sensor_table(sensors: Sequence[SensorSpec], patterns: Mapping[str, Pattern]) -> dict[str, NDArray[Any]]:
    nothing = np.full((3, 3), np.nan)
    shapes = [patterns[spec.name].shape for spec in sensors]
    lenses = [patterns[spec.name].lens for spec in sensors]
    matrices = [patterns[spec.name].intrinsics for spec in sensors]
    return {
        "sensor_name": np.array([spec.name for spec in sensors], dtype=np.str_),
        "sensor_type": np.array([spec.type for spec in sensors], dtype=np.str_),
        "sensor_shape": np.array([(*shape, 0)[:2] for shape in shapes], dtype=np.int64),
        "sensor_intrinsics": np.array([nothing if matrix is None else matrix for matrix in matrices]),
        "sensor_distortion_model": np.array(["" if lens is None else lens.type for lens in lenses], dtype=np.str_),
        "sensor_distortion": np.array([_coefficients(lens) for lens in lenses]),
        "sensor_spec": np.array([_spec_json(spec) for spec in sensors], dtype=np.str_),
    }


def _coefficients(lens: Lens | None) -> NDArray[np.float64]:
    """(8,) those of a lens, then NaN."""
    own = np.empty(0) if lens is None else lens.coefficients
    return np.concatenate([own, np.full(8 - own.size, np.nan)])


def _spec_json(spec: SensorSpec) -> str:
    return json.dumps(spec.model_dump(mode="json"))  # pydantic's own JSON would turn infinity into null
