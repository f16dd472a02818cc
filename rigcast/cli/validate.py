"""`rigcast validate`: check a rig and its model without casting a ray."""

import itertools
import json
from collections.abc import Iterable, Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray
from rich.markup import escape
from rich.table import Table

from rigcast.card import angles_deg, arc_deg
from rigcast.cli.common.options import (
    JsonFile,
    ModelPath,
    Overrides,
    RigPath,
    console_beside,
    counted,
    say,
    show,
    write_json,
)
from rigcast.motion.simulation import initial_data
from rigcast.rig_file import RigConfig, open_rig
from rigcast.sensors.rig.timing.one_state import too_often
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.enclosed import enclosed
from rigcast.sensors.specs.height_scan import HeightScan
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
    show(console, table)
    data = initial_data(compiled, config.keyframe)
    mujoco.mj_fwdPosition(compiled, data)
    remarks = [enclosed(compiled, data, config.sensors), too_often(config.sensors, compiled.opt.timestep)]
    for sentence in itertools.chain(*remarks, _radians(config.sensors)):
        say(console, sentence)
    say(console, f"{rig}: valid, {counted(len(config.sensors), 'sensor')}")
    if json_file is not None:
        write_json(json_file, as_json(config, compiled))


def as_json(config: RigConfig, model: mujoco.MjModel) -> str:
    """Return the rig as JSON, with presets and extended files filled in: files, model, and every key of every sensor.

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


def _view(sensor: SensorSpec, pattern: Pattern) -> str:
    """The field of view of its outermost rays, across and up; reveals radians given for degrees."""
    if isinstance(sensor, HeightScan):
        return "down"
    if isinstance(sensor, DepthCamera):
        return " x ".join(f"{extent:.3g}" for extent in _view_of_camera(pattern))
    azimuth, elevation = angles_deg(sensor, pattern)
    return f"{arc_deg(azimuth):.3g} x {np.ptp(elevation):.3g}"


def _view_of_camera(pattern: Pattern) -> NDArray[np.float64]:
    """The angles [deg] that its rays span across and up, along the row and the column through the optical axis.

    Each ray is at its angle from the axis, in its direction in the image: azimuth and elevation would be those of no
    row or column for a lens that sees behind the camera.
    """
    rays = pattern.directions.reshape(-1, 3)
    rays = rays[np.isfinite(rays).all(axis=1)]
    beside = np.linalg.norm(rays[:, :2], axis=1)
    from_axis = np.rad2deg(np.arctan2(beside, rays[:, 2]))
    placed = rays[:, :2] * (from_axis / np.maximum(beside, 1e-300))[:, None]
    return np.asarray(np.ptp(placed, axis=0))


def _radians(sensors: Iterable[SensorSpec]) -> Iterator[str]:
    """A sentence for each mount with an angle that is a fraction of pi, as hardly one in degrees is."""
    for sensor in sensors:
        for angle in sensor.mount.euler_deg or ():
            for fraction, name in ((1, "pi"), (2, "pi / 2"), (4, "pi / 4")):
                if abs(abs(angle) - np.pi / fraction) < 5e-5:
                    meant = f"{'-' if angle < 0 else ''}{name} to 4 digits"
                    yield f"sensor {sensor.name!r}: euler_deg has {angle:g}, which is {meant}: it is in degrees"


def _place(mount: Mount) -> str:
    return "world" if mount.parent == "world" else f"{mount.parent} {getattr(mount, mount.parent)}"
