"""`rigcast bench`: how fast the demo's sensors are, beside MuJoCo's own ray casters."""

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from rigcast.bench import Result
from rigcast.bench import bench as bench_rig
from rigcast.cli.kernels import ready_rig
from rigcast.cli.options import JsonFile, console_beside, write_json
from rigcast.config import open_rig
from rigcast.simulation import initial_data

SENSORS = ("front", "lidar_top")  # of the demo: a depth camera of 640 x 480, a lidar of 64 x 1024


def bench(
    json_file: JsonFile = None,
    rounds: Annotated[int, typer.Option(min=1, help="times that each caster is timed")] = 7,
    device: Annotated[str | None, typer.Option(help="cpu, cuda:0...  [default: CUDA if present]")] = None,
) -> None:
    """Time the demo's depth camera and lidar beside mj_multiRay and mj_ray."""
    console = console_beside(json_file)
    path = Path(str(files("rigcast.configs"))) / "demo.yaml"
    config, model = open_rig(path)
    data = initial_data(model, config.keyframe)
    rig = ready_rig(console, config, model, data, device)
    with console.status("casting"):
        results = bench_rig(rig, data, SENSORS, rounds=rounds)
    device_name = str(rig.scene.device)
    console.print(f"rigcast {version('rigcast')} on {device_name}, {os.cpu_count()} cores, {rounds} rounds in turn")
    console.print(_table(results))
    if json_file is not None:
        write_json(json_file, as_json(results, device_name, rounds))


def as_json(results: Sequence[Result], device: str, rounds: int) -> str:
    """Return the results as JSON, with what they were measured on. Speeds are in M rays/s."""
    about = {
        "device": device,
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "rounds": rounds,
        "versions": {name: version(name) for name in ("rigcast", "mujoco", "warp-lang", "numpy")},
    }
    return json.dumps({**about, "sensors": [asdict(result) for result in results]}, indent=1) + "\n"


def _table(results: Sequence[Result]) -> Table:
    table = Table("sensor", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.caption = "M rays/s, with scene update and copy to numpy; agree: with mj_ray"
    for column in ("rays", "caster", "median", "lowest", "highest", "ratio", "agree"):
        table.add_column(column, justify="left" if column == "caster" else "right", no_wrap=True)
    for result in results:
        for speed in result.speeds:
            first = speed is result.speeds[0]
            where = (result.sensor, " x ".join(map(str, result.shape))) if first else ("", "")
            speeds = (f"{value:.3f}" for value in (speed.median, speed.lowest, speed.highest))
            ratio = "" if first else f"{speed.ratio:.1f}"
            table.add_row(*where, speed.caster, *speeds, ratio, f"{speed.agree:.3%}")
        table.add_section()
    return table
