"""frames.npz: the index of a run, one row per frame, with the sensors and the names of ids.

Frames, F rows in the order written: `sensor` (F,) str, `frame` (F,) int64, its number within that sensor,
`time` (F,) float64 [s], `pose` (F, 4, 4) float64, sensor in world, and for each format of the run that has files of
frames or cameras (`exr`, `ply`, ...) the file (F,) str, the first if it has several, relative to the folder of
frames.npz, "" where that sensor is not written so.
Sensors, S rows in the order of the rig: `sensor_name`, `sensor_type` (S,) str, `sensor_shape` (S, 2) int64,
the last 0 where rays have one axis only, `sensor_intrinsics` (S, 3, 3) float64, NaN unless a camera,
`sensor_distortion_model` (S,) str, "" without a lens, `sensor_distortion` (S, 8) float64, its coefficients in OpenCV's
order, then NaN,
`sensor_spec` (S,) str, JSON of everything the rig says about it, with Infinity as Python writes and reads it.
Ids: the columns of `IdTable`: `geom_name`, `geom_body`, `geom_class`, `body_name`, `class_name`...

While a run goes on, frames.jsonl has the frames so far: a line of JSON for each, with `sensor`, `frame`, `time`,
`pose` (16 numbers, row by row) and `files` by format. It is what a run that was killed leaves in place of frames.npz.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
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
    """The index of a run's frames, kept in the file `journal` and written as frames.npz at its end."""

    def __init__(
        self,
        journal: Path,
        sensors: Sequence[SensorSpec],
        patterns: Mapping[str, Pattern],
        formats: Sequence[str],
        ids: IdTable,
    ) -> None:
        self._fixed = _sensor_table(sensors, patterns) | vars(ids)
        self._formats = formats
        self._path = journal
        self._journal = journal.open("w", encoding="utf-8")
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, frame: Frame, number: int, files: Mapping[str, str]) -> None:
        """Append a frame; `files` maps format to path relative to the run's folder. Raises OSError on failure."""
        pose = np.asarray(frame.pose, dtype=np.float64).ravel().tolist()
        row = {"sensor": frame.sensor, "frame": number, "time": float(frame.time), "pose": pose, "files": files}
        self._journal.write(json.dumps(row) + "\n")
        self._journal.flush()
        self._count += 1

    def write(self, path: Path) -> None:
        """Write the rows so far to `path`, whatever its suffix. Raises OSError where it cannot be written."""
        with self._path.open(encoding="utf-8") as journal, path.open("wb") as file:
            columns: dict[str, Any] = _frame_table(journal, self._formats) | self._fixed
            np.savez(file, **columns)

    @property
    def closed(self) -> bool:
        return self._journal.closed

    def close(self) -> None:
        """Remove the journal."""
        self._journal.close()
        self._path.unlink(missing_ok=True)


def read_journal(path: Path, formats: Sequence[str]) -> dict[str, NDArray[Any]]:
    """The frames of a run that is under way or was killed, as columns of frames.npz. Raises OSError."""
    with path.open(encoding="utf-8") as journal:
        # the last line may be incomplete
        return _frame_table((line for line in journal if line.endswith("\n")), formats)


def _frame_table(journal: Iterable[str], formats: Sequence[str]) -> dict[str, NDArray[Any]]:
    """The frame columns of frames.npz from the lines of a journal."""
    rows = [json.loads(line) for line in journal]
    return {
        "sensor": np.array([row["sensor"] for row in rows], dtype=np.str_),
        "frame": np.array([row["frame"] for row in rows], dtype=np.int64),
        "time": np.array([row["time"] for row in rows], dtype=np.float64),
        "pose": np.array([row["pose"] for row in rows], dtype=np.float64).reshape(-1, 4, 4),
        **{name: np.array([row["files"].get(name, "") for row in rows], dtype=np.str_) for name in formats},
    }


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
    """The coefficients of a lens, padded with NaN to (8,)."""
    own = np.empty(0) if lens is None else lens.coefficients
    return np.concatenate([own, np.full(8 - own.size, np.nan)])


def _spec_json(spec: SensorSpec) -> str:
    return json.dumps(spec.model_dump(mode="json"))  # pydantic's own JSON would turn infinity into null
