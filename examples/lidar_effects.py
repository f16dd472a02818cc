"""The errors of lidars as pairs of pictures, without and with each, of the scene configs/effects.xml.

python examples/lidar_effects.py [FOLDER]     writes FOLDER/lidar_<effect>.png, by default to docs/sensors
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from sensor_effects import CHECKOUT, SCENE, sheet

import rigcast
from rigcast.sensors.preview.colour import PANEL, Scale

Rgb = NDArray[np.uint8]
Draw = Callable[[rigcast.LidarFrame], Rgb]
SIZE = (400, 300)  # width, height [pixels]
METRES_PER_PIXEL = 6.5 / 300
IMAGE = {"elevation_deg": np.linspace(26.5, -26.5, 150), "columns": 200, "azimuth_deg": (-33.5, 33.5)}
RINGS = {"elevation_deg": np.linspace(-5, 5, 21), "columns": 600, "azimuth_deg": (-60.0, 60.0)}


@dataclass(frozen=True)
class Pair:
    """One picture: a lidar with one set of options beside it with another."""

    name: str
    titles: tuple[str, str]
    options: tuple[dict[str, Any], dict[str, Any]]
    draw: tuple[Draw, Draw]


def ranges(frame: rigcast.LidarFrame) -> Rgb:
    """Range from red at 0.4 m to violet at 5 m; grey no return. Up is up, left is left."""
    return _large(Scale(0.4, 5.0, reverse=True).colours(frame.range.numpy()))


def brightness(frame: rigcast.LidarFrame) -> Rgb:
    """Intensity: black 0, white 1."""
    grey = (255 * np.clip(frame.intensity.numpy(), 0, 1)).astype(np.uint8)
    return _large(np.repeat(grey[..., None], 3, axis=-1))


def from_above(frame: rigcast.LidarFrame) -> Rgb:
    """Points up to 6.5 m ahead, forward up, from violet 0.4 m below the sensor to red 0.4 m above; 1 px is 22 mm."""
    (width, height), points = SIZE, frame.points.numpy().reshape(-1, 3)
    points = points[np.isfinite(points[:, 0])]
    column = np.floor(width / 2 - points[:, 1] / METRES_PER_PIXEL).astype(int)
    row = np.floor(height - 1 - points[:, 0] / METRES_PER_PIXEL).astype(int)
    seen = (column >= 0) & (column < width - 1) & (row >= 1) & (row < height)
    picture = np.tile(np.array(PANEL, np.uint8), (height, width, 1))
    for across in (0, 1):
        for up in (0, 1):
            picture[row[seen] - up, column[seen] + across] = Scale(-0.4, 0.4).colours(points[seen, 2])
    return picture


def _large(pixels: Rgb) -> Rgb:
    """Columns count to the left."""
    return pixels[:, ::-1].repeat(2, axis=0).repeat(2, axis=1)


def _pair(
    name: str,
    title: str,
    options: dict[str, Any],
    draw: Draw = ranges,
    plain: tuple[str, dict[str, Any]] = ("ideal", {}),
) -> Pair:
    pattern = IMAGE if draw is ranges else RINGS
    return Pair(name, (plain[0], title), ({**pattern, **plain[1]}, {**pattern, **options}), (draw, draw))


NARROW = {"beam": rigcast.Beam(divergence_deg=(0.6, 0.3), rings=3), "pulse_length": 3e-8}
WIDE = {"beam": rigcast.Beam(divergence_deg=(1.5, 1.5)), "pulse_length": 1e-9}
NEAR, FAR = rigcast.Detection(range=6), rigcast.Detection(range=60)
PAIRS = (
    Pair("intensity", ("range", "intensity"), (IMAGE, IMAGE), (ranges, brightness)),
    _pair("range_noise", "range_std 30 mm", {"noise": rigcast.Noise(range_std=0.03)}, from_above),
    _pair("resolution", "range_resolution 0.2 m", {"noise": rigcast.Noise(range_resolution=0.2)}, from_above),
    _pair("angle_noise", "angle_std 0.3 deg", {"noise": rigcast.Noise(angle_std_deg=0.3)}),
    _pair("dropout", "dropout 5 %, dark_dropout 80 %", {"noise": rigcast.Noise(dropout=0.05, dark_dropout=0.8)}),
    _pair("detection", "detection: 6 m at 10 %", {"detection": NEAR}),
    _pair("beam", "beams of 0.6 x 0.3 deg, pulses of 30 ns: mixed pixels", NARROW, from_above),
    _pair(
        "returns",
        "returns: last",
        {**WIDE, "returns": "last"},
        plain=("returns: first, of beams of 1.5 deg", {**WIDE, "returns": "first"}),
    ),
    _pair("glass", "max_surfaces 4, returns: last", {"max_surfaces": 4, "pulse_length": 1e-9, "returns": "last"}),
    _pair("mirror", "mirrors, returns: last", {"mirrors": True, "pulse_length": 1e-9, "returns": "last"}),
    _pair(
        "rain",
        "rain of 50 mm/h, returns: first",
        {"weather": rigcast.Weather(rain_rate=50), "detection": FAR, "returns": "first"},
    ),
    _pair(
        "fog",
        "visibility 12 m",
        {"weather": rigcast.Weather(visibility=12), "detection": NEAR},
        plain=("clear air, detection: 6 m at 10 %", {"detection": NEAR}),
    ),
)


def lidar(name: str, options: dict[str, Any]) -> rigcast.Lidar:
    return rigcast.Lidar(**{"name": name, "mount": rigcast.Mount(site="eye"), **options})


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("spinning").id)
    sensors = [lidar(f"{pair.name}_{k}", pair.options[k]) for pair in PAIRS for k in (0, 1)]
    frames = rigcast.Rig(model, sensors).sense(data)
    for pair in PAIRS:
        without, with_it = (pair.draw[k](_as_lidar(frames[f"{pair.name}_{k}"])) for k in (0, 1))
        sheet((without, with_it), pair.titles).save(folder / f"lidar_{pair.name}.png", optimize=True)
    print(f"{len(PAIRS)} pictures in {folder}")


def _as_lidar(frame: rigcast.Frame) -> rigcast.LidarFrame:
    assert isinstance(frame, rigcast.LidarFrame)
    return frame


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else CHECKOUT / "docs" / "sensors")
