"""`rigcast run`: step the simulation, write every due frame, summarise what was written."""

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import mujoco
import typer
from rich.console import Console
from rich.filesize import decimal
from rich.markup import escape
from rich.table import Table

from rigcast.cli.common.moving import Controller, Motion, MotionRate, moving
from rigcast.cli.common.options import Device, ModelPath, Overrides, RigPath, Seed, counted, say, show
from rigcast.cli.common.progress import progress
from rigcast.cli.common.ready import ready_rig
from rigcast.export.files import make_writable
from rigcast.motion.simulation import Spent, initial_data, step_count
from rigcast.motion.steps import Diverged, Step
from rigcast.recording.formats import FORMATS, choose_formats
from rigcast.recording.layout import INDEX_NAME
from rigcast.recording.recorder import Recorder
from rigcast.rig_file import open_rig
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.rig.timing.schedule import Schedule
from rigcast.sensors.specs.sensor_spec import SensorSpec

DURATION = 3.0
"""Default time to simulate [s]."""


def run(
    rig: RigPath,
    model: ModelPath = None,
    out: Annotated[Path | None, typer.Option(help="folder to write to  [default: out/<rig>]")] = None,
    duration: Annotated[
        float | None, typer.Option(help="time to simulate [s]  [default: 3, or as long as the motion]")
    ] = None,
    formats: Annotated[
        str | None,
        typer.Option(
            "--format", help=f"one or more of {','.join(FORMATS)}  [default: exr for cameras, ply for others]"
        ),
    ] = None,
    controller: Controller = None,
    motion: Motion = None,
    motion_rate: MotionRate = None,
    device: Device = None,
    seed: Seed = None,
    overrides: Overrides = None,
) -> None:
    """Simulate a rig on its model and write the frames of its sensors."""
    console = Console(highlight=False)
    began = perf_counter()
    config, compiled = open_rig(rig, model, overrides or ())
    moved = moving(rig, compiled, controller, motion, motion_rate)
    asked = moved.duration(duration)
    simulated = DURATION if asked is None else asked
    steps = step_count(compiled, simulated)
    folder = Path("out") / rig.stem if out is None else out
    wanted = None if formats is None else split_formats(formats)
    choose_formats(config.sensors, wanted)
    make_writable(folder)  # mistakes are reported before anything is compiled
    data = initial_data(compiled, config.keyframe)
    started = data.time
    step = moved.step(compiled, data, config.seed if seed is None else seed)
    loaded = ready_rig(console, config, compiled, data, device, seed)
    how: dict[str, Any] = {"classes": config.classes, "props": config.props, "options": config.export}
    recorder = Recorder(folder, compiled, config.sensors, wanted, **how)
    names = ", ".join(spec.name for spec in config.sensors)
    spent = Spent(loading=perf_counter() - began)
    try:
        say(console, f"{rig}: {names}; {simulated:g} s on {loaded.scene.device}, to {folder}")
        with progress(console, steps * compiled.opt.timestep) as report:
            simulate(loaded, data, step, steps, recorder, spent, report)
    except KeyboardInterrupt:
        say(console, f"{counted(recorder.frames, 'frame')} from before Ctrl-C are in {folder}")
        raise
    finally:
        with spent.on("writing"):
            recorder.finish()
    show(console, summary(config.sensors, recorder, compiled, started))
    for path in recorder.run_files:
        say(console, f"{path}: the whole run, {decimal(_size(path))}")
    say(console, f"{folder / INDEX_NAME}: index of {counted(recorder.frames, 'frame')}")
    say(console, f"{spent.sentence()}, {perf_counter() - began:.1f} s in all")


def split_formats(text: str) -> list[str]:
    """`"exr, ply"` as `["exr", "ply"]`."""
    return [name.strip().lower() for name in text.split(",") if name.strip()]


def simulate(
    rig: Rig,
    data: mujoco.MjData,
    step: Step,
    steps: int,
    recorder: Recorder,
    spent: Spent,
    report: Callable[[float, int], None],
) -> None:
    """Take `steps` steps, sense after each one and write the due frames.

    `report` is called after every step with the time simulated [s] and the frames written so far.

    Raises:
        InputError: the simulation diverged, or a file cannot be written. Earlier frames are complete.
    """
    recorder.step(data, ())
    for number in range(1, steps + 1):
        with spent.on("physics"):
            _take(step, recorder)
        with spent.on("casting"):
            frames = rig.step(data)
        with spent.on("writing"):
            recorder.step(data, frames)
        report(number * rig.model.opt.timestep, recorder.frames)


def _take(step: Step, recorder: Recorder) -> None:
    try:
        step()
    except Diverged as error:
        written = f"{counted(recorder.frames, 'frame')} from before are in {recorder.folder}"
        raise InputError(f"{error}; {written}") from None


def summary(sensors: Sequence[SensorSpec], recorder: Recorder, model: mujoco.MjModel, started: float) -> Table:
    """A table of what has been written for each sensor, or how long after `started` [s] its first frame comes."""
    table = Table("sensor", "type")
    for column in ("frames", "files", "size"):
        table.add_column(column, justify="right")
    table.add_column("in")
    for spec in sensors:
        output = recorder.outputs[spec.name]
        folder = str(output.folder) if output.frames else _no_frame(spec, model, started)
        counts = (str(output.frames), str(output.files), decimal(output.size))
        table.add_row(spec.name, spec.type, *counts, escape(folder))
    return table


def _no_frame(spec: SensorSpec, model: mujoco.MjModel, started: float) -> str:
    """Why a run had no frame of a sensor: it ended before the first one's last ray, or the sensor lost all."""
    if spec.rate_hz is None:
        return "(no frame)"
    due = Schedule(spec.rate_hz, model.opt.timestep, phase=spec.phase).after(started)
    fired = spec.pattern(model).duration if spec.moves else 0.0
    return f"(no frame: the first is complete after {due - started + fired + spec.latency:.4g} s)"


def _size(folder: Path) -> int:
    """Total size of the files in a folder [bytes]."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
