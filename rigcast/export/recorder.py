"""The folder that a run leaves: DIR/<sensor>/000000.<format>, DIR/<sensor>/preview.png, DIR/frames.npz."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import mujoco

from rigcast.export.exr import write_exr
from rigcast.export.files import make_writable, replacing
from rigcast.export.formats import choose_formats
from rigcast.export.ids import IdTable
from rigcast.export.index import FrameIndex
from rigcast.export.npz import write_npz
from rigcast.export.ply import write_ply
from rigcast.sensors.preview import draw_preview
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.specs.sensor_spec import SensorSpec

INDEX_NAME = "frames.npz"
PREVIEW_NAME = "preview.png"


@dataclass
class SensorOutput:
    """What has been written of one sensor: frames, files and their bytes, and the latest frame."""

    folder: Path
    formats: tuple[str, ...]
    frames: int = 0
    files: int = 0
    size: int = 0
    latest: Frame | None = field(default=None, repr=False)

    def count(self, path: Path) -> None:
        self.files += 1
        self.size += path.stat().st_size


class Recorder:
    """Writes the frames of one rig as they come; keeps the index and each sensor's latest frame.

    Frame files and the preview that an earlier run left in the same sensor folders are removed first.

    Args:
        folder: DIR, created if need be.
        model, sensors: of the rig whose frames will come.
        formats: any of "exr", "ply", "npz"; None is exr for cameras, ply for the others.

    Raises:
        InputError: a format that does not exist or does not fit a sensor; a folder that cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        model: mujoco.MjModel,
        sensors: Sequence[SensorSpec],
        formats: Sequence[str] | None = None,
    ) -> None:
        chosen = choose_formats(sensors, formats)
        self.folder = folder
        self.outputs = {name: SensorOutput(folder / name, formats) for name, formats in chosen.items()}
        self._patterns = {spec.name: spec.pattern(model) for spec in sensors}
        self._ids = IdTable.of(model)
        used = sorted({name for formats in chosen.values() for name in formats})
        self._index = FrameIndex(sensors, self._patterns, used, self._ids)
        for path in (folder, *(output.folder for output in self.outputs.values())):
            make_writable(path)
        self._clear()

    @property
    def frames(self) -> int:
        """How many frames have been written, all sensors together."""
        return len(self._index)

    def write(self, frame: Frame) -> None:
        """Write one frame in every format of its sensor. Raises InputError where a file cannot be written."""
        output = self.outputs[frame.sensor]
        files = {}
        for name in output.formats:
            path = output.folder / f"{output.frames:06d}.{name}"
            with replacing(path) as temporary:
                self._write_as(name, temporary, frame)
            output.count(path)
            files[name] = path.relative_to(self.folder).as_posix()
        self._index.add(frame, output.frames, files)
        output.frames += 1
        output.latest = frame

    def finish(self) -> None:
        """Write frames.npz, and a preview of the latest frame of every sensor that had one."""
        with replacing(self.folder / INDEX_NAME) as temporary:
            self._index.write(temporary)
        for name, output in self.outputs.items():
            if output.latest is not None:
                self._preview(name, output, output.latest)

    def _preview(self, name: str, output: SensorOutput, frame: Frame) -> None:
        picture = draw_preview(self._patterns[name], frame)
        with replacing(output.folder / PREVIEW_NAME) as temporary:
            picture.save(temporary, format="png")
        output.count(output.folder / PREVIEW_NAME)

    def _write_as(self, name: str, path: Path, frame: Frame) -> None:
        if name == "exr":
            write_exr(path, cast(CameraFrame, frame), self._ids)
        elif name == "ply":
            write_ply(path, frame)
        else:
            write_npz(path, frame)

    def _clear(self) -> None:
        (self.folder / INDEX_NAME).unlink(missing_ok=True)
        for output in self.outputs.values():
            for path in output.folder.iterdir():
                if path.name == PREVIEW_NAME or re.fullmatch(r"\d{6,}\.(exr|ply|npz)", path.name):
                    path.unlink()
