"""frames.zarr: the frames of a run as arrays that grow, for long recordings.

A group per sensor, with one row, and one chunk, per frame: `time` (F,) float64 [s], `pose` (F, 4, 4) float64, sensor
in world, and every per-ray field of the frame (F, ...), misses included, as Frame has them. Attributes of a group:
`type`, `spec` (JSON), and of a camera what `camera_fields` has; of the root: `ids`, the columns of `IdTable`.
After a crash some rows at the end are empty: those whose `time` is NaN. It is written last, so all others are whole.

Zarr makes the groups and arrays. Chunks, which are compressed bytes in files of known names, and how many rows there
are, in each array's zarr.json, are written here: in Zarr's own hands that takes twenty times as long.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.export.fields import FIELD_NAMES, camera_fields, fields_of
from rigcast.export.ids import IdTable
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.specs.sensor_spec import SensorSpec

_BLOCK = 256  # rows that arrays grow by; each time costs as much as writing a frame
_LEVEL = 1  # of Zstandard: higher ones make noisy ranges no smaller, and take longer
_SEPARATOR = "."  # between the indices of a chunk in its file's name


class ZarrStore:
    """A Zarr store (format 3) that is being written. Raises OSError where it cannot be.

    fields: by the name of a sensor, the per-ray fields that are written; all of a sensor that it does not name.
    """

    def __init__(
        self,
        folder: Path,
        sensors: Sequence[SensorSpec],
        ids: IdTable,
        fields: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        import zarr
        from numcodecs.zstd import Zstd

        self._folder, self._fields = folder, fields or {}
        self._compress = Zstd(_LEVEL).encode
        self._root = zarr.create_group(store=str(folder), zarr_format=3, attributes={"ids": ids.lists()})
        self._groups: dict[str, Any] = {}
        self._shapes: dict[str, dict[str, tuple[int, ...]]] = {}  # of a row of each array, by sensor
        self._frames = dict.fromkeys((spec.name for spec in sensors), 0)
        for spec in sensors:
            about = {"type": spec.type, "spec": json.dumps(spec.model_dump(mode="json"))}
            self._groups[spec.name] = self._root.create_group(spec.name, attributes=about)

    def step(self, _data: mujoco.MjData | None, frames: Sequence[Frame]) -> None:
        """Append frames."""
        for frame in frames:
            self.write(frame)

    def write(self, frame: Frame) -> None:
        """Append one frame. Raises InputError for one of other fields or shapes than its sensor's first."""
        chosen = self._fields.get(frame.sensor, FIELD_NAMES)
        rows = {"pose": np.ascontiguousarray(frame.pose), **fields_of(frame, chosen)}
        rows["time"] = np.asarray(frame.time)  # last: a row that has it is whole
        number, shapes = self._frames[frame.sensor], {name: row.shape for name, row in rows.items()}
        if frame.sensor not in self._shapes:
            self._create(frame, rows)
            self._shapes[frame.sensor] = shapes
        expected = self._shapes[frame.sensor]
        if shapes != expected:
            words = f"got a frame of {shapes}, expected {expected} like its first"
            raise InputError(f"zarr: sensor {frame.sensor!r}: {words}")
        if number % _BLOCK == 0:
            self._resize(frame.sensor, number + _BLOCK)
        for name, row in rows.items():
            chunk = _SEPARATOR.join(["c", str(number), *["0"] * row.ndim])
            self.write_chunk(f"{frame.sensor}/{name}/{chunk}", self._compress(row))
        self._frames[frame.sensor] += 1

    def close(self) -> None:
        """Cut off the rows that were not filled."""
        for name in self._shapes:
            self._resize(name, self._frames[name])

    def write_chunk(self, key: str, chunk: bytes) -> None:
        """Put the bytes of a chunk where readers look for them: at `key` within the store."""
        (self._folder / key).write_bytes(chunk)

    def _resize(self, sensor: str, count: int) -> None:
        for name in self._shapes[sensor]:
            path = self._folder / sensor / name / "zarr.json"
            about = json.loads(path.read_text())
            about["shape"][0] = count
            temporary = path.with_suffix(".part")
            temporary.write_text(json.dumps(about, indent=2))
            temporary.replace(path)

    def _create(self, frame: Frame, rows: dict[str, NDArray[Any]]) -> None:
        from zarr.codecs import ZstdCodec

        group = self._groups[frame.sensor]
        if isinstance(frame, CameraFrame):
            group.attrs.update({name: value.tolist() for name, value in camera_fields(frame).items()})
        for name, row in rows.items():
            group.create_array(
                name,
                shape=(0, *row.shape),
                chunks=(1, *row.shape),
                dtype=row.dtype,
                fill_value=np.nan if name == "time" else 0,
                chunk_key_encoding={"name": "default", "separator": _SEPARATOR},
                compressors=ZstdCodec(level=_LEVEL),
            )
