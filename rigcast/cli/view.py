"""`rigcast view`: look at a rig, at what a run has written, or at a bag."""

import math
import webbrowser
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, NamedTuple

import mujoco
import typer
from rich.console import Console

from rigcast.cli.common.moving import Controller, Motion, MotionRate, Moving, moving
from rigcast.cli.common.options import Device, ModelPath, Overrides, Seed, counted, say
from rigcast.cli.common.progress import progress
from rigcast.cli.common.ready import ready_rig
from rigcast.export.files import make_room_for, replacing
from rigcast.motion.simulation import initial_data, step_count
from rigcast.rig_file import RigConfig, open_rig
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.view.bag import is_bag, read_bag
from rigcast.view.in_rerun import Moment, load_rerun, show_in_rerun
from rigcast.view.page import MOST_POINTS, MOST_SHOTS, WIDEST, write_page
from rigcast.view.run_folder import read_run
from rigcast.view.shots import Share, Shot, shot_of


class _Seen(NamedTuple):
    shots: list[Shot]
    model: mujoco.MjModel | None
    moments: list[Moment]


def view(
    target: Annotated[Path, typer.Argument(help="a rig, a folder of `rigcast run` or a ROS 2 bag", show_default=False)],
    save: Annotated[
        Path | None, typer.Option(help="write a page (.html) or a rerun recording (.rrd) instead of showing it")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="time to simulate a rig [s]  [default: 1, or as long as the motion]")
    ] = None,
    controller: Controller = None,
    motion: Motion = None,
    motion_rate: MotionRate = None,
    model: ModelPath = None,
    device: Device = None,
    seed: Seed = None,
    overrides: Overrides = None,
) -> None:
    """Show point clouds and depth images over time: in rerun if it is installed, else as a page in the browser.

    A folder's frames are shown if they are npz, exr or ply, else its bag. From any ROS 2 bag, point clouds, scans and
    depth images are shown.
    """
    console = Console(highlight=False)
    suffix = _suffix(save)
    recorded = target.is_dir() or is_bag(target)
    if recorded:
        moves = {"--controller": controller, "--motion": motion, "--motion-rate": motion_rate}
        rigs = {"--duration": duration, **moves, "--model": model, "--device": device, "--seed": seed}
        _refuse({**rigs, "--set": overrides}, target)
    if suffix == ".rrd":
        load_rerun()  # before anything that takes long
    if save is not None:
        make_room_for(save)
    if recorded:
        seen = _recorded(target, suffix)
    else:
        config, compiled = open_rig(target, model, overrides or ())
        moved = moving(target, compiled, controller, motion, motion_rate)
        asked = moved.duration(duration)
        seen = _simulated(console, config, compiled, moved, 1.0 if asked is None else asked, device, seed, suffix)
    if suffix == ".rrd":
        _show_in_rerun(console, target.stem, seen, save)
    else:
        _show_page(console, target.stem, seen.shots, save)


def _refuse(options: Mapping[str, object], target: Path) -> None:
    """Raise InputError if one of these options for rigs was given."""
    given = [name for name, value in options.items() if value not in (None, [])]
    if given:
        raise InputError(f"{', '.join(given)}: expected with a rig only; {target} is shown as it was recorded")


def _suffix(save: Path | None) -> str:
    """The suffix of the output: .rrd or .html."""
    if save is None:
        return ".rrd" if find_spec("rerun") else ".html"
    if save.suffix not in (".rrd", ".html"):
        raise InputError(f"--save: got {str(save)!r}, expected a name that ends in .html or .rrd")
    return save.suffix


def _recorded(target: Path, suffix: str) -> _Seen:
    most = _most(suffix)
    shots = [_kept(shot, suffix) for shot in (read_bag(target, most) if is_bag(target) else read_run(target, most))]
    if not shots:
        raise InputError(f"{target}: no frame to show")
    return _Seen(shots, None, [])


def _most(suffix: str) -> int | None:
    """Most shots that are shown; None for all."""
    return MOST_SHOTS if suffix == ".html" else None


def _kept(shot: Shot, suffix: str) -> Shot:
    """A shot reduced to what is shown, to limit the memory for long recordings."""
    return shot.thinned(MOST_POINTS, WIDEST) if suffix == ".html" else shot


def _simulated(
    console: Console,
    config: RigConfig,
    compiled: mujoco.MjModel,
    moved: Moving,
    duration: float,
    device: str | None,
    seed: int | None,
    suffix: str,
) -> _Seen:
    steps, data = step_count(compiled, duration), initial_data(compiled, config.keyframe)
    step = moved.step(compiled, data, config.seed if seed is None else seed)
    loaded = ready_rig(console, config, compiled, data, device, seed)
    most = [_most_readings(sensor, steps * compiled.opt.timestep, steps) for sensor in loaded.sensors]
    seen, share = _Seen([], compiled, []), Share(most, _most(suffix))
    with progress(console, steps * compiled.opt.timestep) as report:
        for number in range(1, steps + 1):
            step()
            new = [_kept(shot_of(frame), suffix) for frame in loaded.step(data) if share.takes(frame.sensor)]
            seen.shots.extend(new)
            if new:
                mujoco.mj_kinematics(compiled, data)  # the present poses, as in the frames
                seen.moments.append(Moment(data.time, data.xpos.copy(), data.xquat.copy()))
            report(number * compiled.opt.timestep, len(seen.shots))
    if not seen.shots:
        raise InputError(f"{config.path}: no frame was complete in {duration:g} s")
    return seen


def _most_readings(sensor: SensorSpec, duration: float, steps: int) -> int:
    """Most readings that a sensor can have in `duration` [s] and `steps` steps."""
    return steps if sensor.rate_hz is None else math.ceil(duration * sensor.rate_hz) + 1


def _show_in_rerun(console: Console, title: str, seen: _Seen, save: Path | None) -> None:
    if save is None:
        show_in_rerun(title, seen.shots, None, seen.model, seen.moments)
        return
    with replacing(save) as temporary:
        show_in_rerun(title, seen.shots, temporary, seen.model, seen.moments)
    say(console, f"{save}: {counted(len(seen.shots), 'frame')}; `rerun {save}` shows them")


def _show_page(console: Console, title: str, shots: list[Shot], save: Path | None) -> None:
    path = Path("out") / f"{title}.html" if save is None else save
    make_room_for(path)
    with replacing(path) as temporary:
        write_page(temporary, title, shots)
    say(console, f"{path}: {counted(len(shots), 'frame')}")
    if save is None and console.is_terminal:
        webbrowser.open(path.resolve().as_uri())
