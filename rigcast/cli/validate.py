"""`rigcast validate`: check a rig and its model without casting a ray."""

import json
from collections.abc import Iterable, Iterator

import mujoco
import numpy as np
from rich.markup import escape
from rich.table import Table

from rigcast.card import angles_deg, arc_deg
from rigcast.cli.common.options import JsonFile, ModelPath, Overrides, RigPath, console_beside, counted, say, write_json
from rigcast.motion.simulation import initial_data
from rigcast.rig_file import RigConfig, open_rig
from rigcast.sensors.specs.enclosed import enclosed
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.pattern import Pattern
from rigcast.sensors.specs.sensor_spec import SensorSpec


def validate(
    rig: RigPath,
    model: ModelPath = None,
    json_file: JsonFile = None,
    overrides: Overrides = None,
) -> None:
    """Check a rig and its model: show all mistakes, or list the sensors."""
    config, compiled = open_rig(rig, model, overrides or ())
    table = Table("sensor", "type", "rays", r"view \[deg]", "rate", "mount")
    for sensor in config.sensors:
        pattern = sensor.pattern(compiled)
        rays = " x ".join(str(extent) for extent in pattern.shape)
        rate = "every step" if sensor.rate_hz is None else f"{sensor.rate_hz:g} Hz"
        table.add_row(sensor.name, sensor.type, rays, _view(sensor, pattern), rate, escape(_place(sensor.mount)))
    console = console_beside(json_file)
    console.print(table)
    data = initial_data(compiled, config.keyframe)
    mujoco.mj_fwdPosition(compiled, data)
    for sentence in [*enclosed(compiled, data, config.sensors), *_too_often(compiled, config.sensors)]:
        say(console, sentence)
    say(console, f"{rig}: valid, {counted(len(config.sensors), 'sensor')}")
    if json_file is not None:
        write_json(json_file, as_json(config, compiled))


def as_json(config: RigConfig, model: mujoco.MjModel) -> str:
    """Return the rig as JSON, presets and what it extends filled in: files, model, and every key of every sensor.

    Keys are those of the YAML; an unlimited range is null. `shape` is that of a sensor's readings.
    """
    document = {
        "rig": str(config.path),
        "files": [str(path) for path in config.files],
        "model": None if config.model is None else str(config.model),
        "seed": config.seed,
        "keyframe": config.keyframe,
        "sensors": [
            {**json.loads(sensor.model_dump_json()), "shape": sensor.pattern(model).shape} for sensor in config.sensors
        ],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _too_often(model: mujoco.MjModel, sensors: Iterable[SensorSpec]) -> Iterator[str]:
    """A sentence for each sensor that reads several times in a step, which is one state for all but those that move."""
    steps = 1 / float(model.opt.timestep)
    for sensor in sensors:
        if sensor.rate_hz is not None and sensor.rate_hz > steps * (1 + 1e-6) and not sensor.moves:
            yield (
                f"sensor {sensor.name!r} reads at {sensor.rate_hz:g} Hz, the model steps at {steps:g} Hz: the frames "
                "of a step show the same state"
            )


def _view(sensor: SensorSpec, pattern: Pattern) -> str:
    """How far its outermost rays are apart, across and up: who gives radians for degrees sees it."""
    if sensor.yaw_aligned:
        return "down"
    azimuth, elevation = angles_deg(sensor, pattern)
    return f"{arc_deg(azimuth):.3g} x {np.ptp(elevation):.3g}"


def _place(mount: Mount) -> str:
    return "world" if mount.parent == "world" else f"{mount.parent} {getattr(mount, mount.parent)}"
