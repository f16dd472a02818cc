"""Readings that take time as pairs of pictures, without and with, of the scene configs/effects.xml in motion.

python examples/motion_effects.py [FOLDER]     writes FOLDER/<effect>.png, by default to docs/sensors
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from lidar_effects import from_above
from numpy.typing import NDArray
from sensor_effects import CHECKOUT, OPTICS, SCENE, depth, sheet

import rigcast

Rgb = NDArray[np.uint8]
RINGS: dict[str, Any] = {
    "elevation_deg": np.linspace(-12, 4, 17).tolist(),
    "columns": 1800,
    "rate_hz": 10.0,
    "clockwise": True,
}


@dataclass(frozen=True)
class Pair:
    """One picture: a sensor beside the same one with an effect, drawn alike."""

    name: str
    titles: tuple[str, str]
    sensors: tuple[rigcast.Lidar | rigcast.DepthCamera, rigcast.Lidar | rigcast.DepthCamera]
    draw: Callable[[Any], Rgb]


def lidar(name: str, **options: Any) -> rigcast.Lidar:
    return rigcast.Lidar(name=name, mount=rigcast.Mount(site="cart"), **RINGS, **options)


def camera(name: str, **options: Any) -> rigcast.DepthCamera:
    optics: dict[str, Any] = {**OPTICS, "rate_hz": 10.0, **options}
    return rigcast.DepthCamera(name=name, mount=rigcast.Mount(camera="eye"), **optics)


def fan(frame: rigcast.CameraFrame) -> Rgb:
    """z-depth around the fan, four times as large."""
    return depth(frame)[57:132, 150:250].repeat(4, axis=0).repeat(4, axis=1)


PAIRS = (
    Pair(
        "lidar_motion",
        ("the world stands still for a turn", "motion, at 2 m/s and 4 rad/s"),
        (lidar("still"), lidar("moving", motion=True)),
        from_above,
    ),
    Pair(
        "rolling_shutter",
        ("global shutter, fan at 40 rad/s", "readout_time 50 ms"),
        (camera("global"), camera("rolling", readout_time=0.05)),
        fan,
    ),
)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("moving").id)
    rig = rigcast.Rig(model, [sensor for pair in PAIRS for sensor in pair.sensors])
    frames: dict[str, rigcast.Frame] = {}
    while len(frames) < 2 * len(PAIRS):
        mujoco.mj_step(model, data)
        for frame in rig.step(data):
            frames.setdefault(frame.sensor, frame)
    for pair in PAIRS:
        without, with_it = (pair.draw(frames[sensor.name]) for sensor in pair.sensors)
        sheet((without, with_it), pair.titles).save(folder / f"{pair.name}.png", optimize=True)
    print(f"{len(PAIRS)} pictures in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else CHECKOUT / "docs" / "sensors")
