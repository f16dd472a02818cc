"""Recording of a rig's frames into the folder of a run, see `layout`."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count, groupby
from pathlib import Path
from types import NoneType, TracebackType

import mujoco

from rigcast.export.files import make_writable, replacing, require_disk_space, uninterrupted
from rigcast.export.frames.exr import write_exr
from rigcast.export.frames.writers import file_writers
from rigcast.export.ids import Classes, IdTable, require_few_classes
from rigcast.export.options import Export
from rigcast.recording.formats import FORMATS, choose_formats
from rigcast.recording.index import FrameIndex
from rigcast.recording.layout import (
    CAMERAS_NAME,
    IDS_NAME,
    INDEX_NAME,
    JOURNAL_NAME,
    PREVIEW_NAME,
    clear_earlier_run,
    refuse_names,
)
from rigcast.recording.run_files import RunFiles
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.rig.frame import CameraFrame, Frame, as_frames
from rigcast.sensors.specs.prop import Prop, as_props
from rigcast.sensors.specs.sensor_spec import SensorSpec

_ROOM = 2**24  # bytes kept free for the index and the ends of recordings, and per frame written ...
_ROOM_PER_FRAME = 1024  # ... their rows
_PER_RAY = 128  # bytes of all fields of a ray, rounded up


@dataclass
class SensorOutput:
    """Totals of one sensor: frames, files of its own and their bytes; and its latest frame."""

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
    """Writes the frames of one rig as they arrive, in constant memory; keeps each sensor's latest frame.

    Files of an earlier run with the same names are removed first. Leaving a `with` block calls `finish`.

    Args:
        folder: where to write; created if missing.
        model: the rig's.
        sensors: those of the rig whose frames will be written.
        formats: any of exr, exr_multipart and png, for cameras only, and ply, pcd, las, laz, kitti, nuscenes, npz,
            zarr, mcap and sqlite3; None is exr for cameras, ply for the others.
        classes: names of geoms, bodies, flexes, skins and props by class, as in a rig's `classes:`.
        props: those of the rig.
        options: as in a rig's `export:`.

    Raises:
        InputError: a format that does not exist, is not installed or does not fit a sensor; classes that do not fit
            the model or are too many for a format; a sensor with a name that the folder or ROS does not allow; a folder
            that cannot be written.

    >>> with Recorder("out", model, rig.sensors, ["npz", "mcap"]) as recorder:
    ...     mujoco.mj_step(model, data)
    ...     recorder.step(data, rig.step(data))
    """

    def __init__(
        self,
        folder: str | Path,
        model: mujoco.MjModel,
        sensors: Sequence[SensorSpec],
        formats: Sequence[str] | None = None,
        *,
        classes: Classes | None = None,
        props: Sequence[Prop] = (),
        options: Export | None = None,
    ) -> None:
        require_type("Recorder: folder", folder, str, Path)
        require_type("Recorder: model", model, mujoco.MjModel)
        require_type("Recorder: sensors", sensors, Sequence)
        for k, spec in enumerate(sensors):
            require_type(f"Recorder: sensors[{k}]", spec, SensorSpec)
        require_type("Recorder: options", options, Export, NoneType)
        chosen = choose_formats(sensors, formats)
        options = Export() if options is None else options
        ids = IdTable.of(model, classes, as_props(props))
        used = sorted({name for formats in chosen.values() for name in formats})
        refuse_names(spec.name for spec in sensors)
        for name in used:
            require_few_classes(ids, FORMATS[name].most_classes, name)
        self.folder = Path(folder)
        self.outputs = {name: SensorOutput(self.folder / name, formats) for name, formats in chosen.items()}
        patterns = {spec.name: spec.pattern(model) for spec in sensors}
        self._ids, self._options = ids, options
        self._writers = file_writers(ids, options)
        groups = [self.folder / CAMERAS_NAME] if "exr_multipart" in used else []
        for path in (self.folder, *groups, *(output.folder for output in self.outputs.values())):
            make_writable(path)
        clear_earlier_run(self.folder, self.outputs)
        whole_runs = [name for name in used if FORMATS[name].holds == "run"]
        self._runs = RunFiles(self.folder, whole_runs, model, sensors, ids, options)
        self.run_files = self._runs.paths
        self._groups = 0
        with replacing(self.folder / IDS_NAME) as temporary:
            temporary.write_text(ids.json())
        indexed = [name for name in used if name not in whole_runs]
        self._index = FrameIndex(self.folder / JOURNAL_NAME, sensors, patterns, indexed, ids)

    @property
    def frames(self) -> int:
        """Number of frames written, of all sensors."""
        return len(self._index)

    def write(self, frame: Frame) -> None:
        """Write one frame, as `step` does, but without the clock and the transforms of bodies in bags."""
        self._record(None, [frame])

    def step(self, data: mujoco.MjData, frames: Iterable[Frame]) -> None:
        """Write the frames of one simulation step, each in every format of its sensor.

        Call it after every step, with or without frames, and once before the first step: bags also hold the clock and
        the motion of bodies between frames. Ctrl-C waits until the frames are written.

        Raises:
            InputError: frames that are not of these sensors or of many worlds; after `finish`; or a file cannot be
                written. The message says what was saved before.
        """
        self._record(data, frames)

    def finish(self) -> None:
        """Complete all recordings, write frames.npz and a preview of the latest frame of every sensor that had one.

        After that no frame is accepted, and another call does nothing.

        Raises:
            InputError: a file cannot be written. The message says what was saved before.
        """
        if self._index.closed:
            return
        with self._saying_what_is_saved(), uninterrupted():
            failures = self._runs.finish()
            with replacing(self.folder / INDEX_NAME) as temporary:
                self._index.write(temporary)
            self._index.close()
            for output in self.outputs.values():
                if output.latest is not None:
                    self._preview(output, output.latest)
            if failures:
                raise InputError("\n".join(failures))

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish()

    def _record(self, data: mujoco.MjData | None, frames: Iterable[Frame]) -> None:
        if self._index.closed:
            raise InputError(f"Recorder: already finished, expected a new one for more frames; {self._saved()}")
        frames = as_frames("Recorder: frames", frames, self.outputs)
        with self._saying_what_is_saved(), uninterrupted():
            self._require_disk_space(frames)
            written: list[Path] = []
            try:
                numbers = self._numbers(frames)
                files = [self._write_files(*numbered, written) for numbered in zip(frames, numbers, strict=True)]
                self._write_parts(frames, files, written)
                self._runs.step(data, frames)
            except BaseException:
                for path in written:  # a frame is saved completely or not at all
                    path.unlink(missing_ok=True)
                raise
            for frame, paths in zip(frames, files, strict=True):
                self._count(frame, paths)

    def _numbers(self, frames: Sequence[Frame]) -> list[int]:
        """The number of each frame within its sensor; several frames of one may fall due in one step."""
        following = {name: count(output.frames) for name, output in self.outputs.items()}
        return [next(following[frame.sensor]) for frame in frames]

    def _write_files(self, frame: Frame, number: int, written: list[Path]) -> dict[str, list[Path]]:
        """Write the files of one frame; their paths by format, and in `written` too, as they come."""
        output = self.outputs[frame.sensor]
        files: dict[str, list[Path]] = {}
        for name in output.formats:
            for suffix, write in zip(FORMATS[name].suffixes, self._writers.get(name, ()), strict=False):
                path = output.folder / f"{number:06d}{suffix}"
                with replacing(path) as temporary:
                    write(temporary, frame)
                written.append(path)
                files.setdefault(name, []).append(path)
        return files

    def _write_parts(
        self, frames: Sequence[Frame], files: Sequence[dict[str, list[Path]]], written: list[Path]
    ) -> None:
        """Write one file for the cameras of each time, and add it to the `files` of their frames."""
        name = "exr_multipart"
        cameras = [
            (frame, paths)
            for frame, paths in zip(frames, files, strict=True)
            if isinstance(frame, CameraFrame) and name in self.outputs[frame.sensor].formats
        ]
        for _, group in groupby(cameras, key=lambda pair: pair[0].time):
            parts = list(group)
            path = self.folder / CAMERAS_NAME / f"{self._groups:06d}.exr"
            with replacing(path) as temporary:
                write_exr(temporary, [frame for frame, _ in parts], self._ids, self._options.exr_compression)
            written.append(path)
            self._groups += 1
            for _, paths in parts:
                paths[name] = [path]

    def _count(self, frame: Frame, files: dict[str, list[Path]]) -> None:
        output = self.outputs[frame.sensor]
        names = {name: paths[0].relative_to(self.folder).as_posix() for name, paths in files.items()}
        self._index.add(frame, output.frames, names)
        for path in (path for paths in files.values() for path in paths):
            output.count(path)
        output.frames += 1
        output.latest = frame

    def _require_disk_space(self, frames: Sequence[Frame]) -> None:
        """Raise an error while there is still room to complete the files that were begun."""
        size = _PER_RAY * sum(frame.range.size for frame in frames)
        formats = max(len(output.formats) for output in self.outputs.values())
        require_disk_space(self.folder, _ROOM + _ROOM_PER_FRAME * self.frames + 2 * formats * size)

    @contextmanager
    def _saying_what_is_saved(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = f"{self.folder}: cannot be written: {error.strerror or error}"
            raise InputError(f"{reason}; {self._saved()}") from error
        except InputError as error:
            raise InputError(f"{error}; {self._saved()}") from error

    def _saved(self) -> str:
        return f"{self.frames} frames from before are in {self.folder}"

    def _preview(self, output: SensorOutput, frame: Frame) -> None:
        picture = frame.picture()
        with replacing(output.folder / PREVIEW_NAME) as temporary:
            picture.save(temporary, format="png")
        output.count(output.folder / PREVIEW_NAME)
