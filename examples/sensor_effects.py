"""The errors of sensors as pairs of pictures, without and with each, of the scene configs/effects.xml.

python examples/sensor_effects.py [FOLDER]     writes FOLDER/<effect>.png, by default to docs/sensors
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import rigcast
from rigcast.sensors.preview.colour import BACKGROUND, FAINT, TEXT, Scale
from rigcast.sensors.preview.page import font

CHECKOUT = Path(__file__).resolve().parents[1]
SCENE = CHECKOUT / "configs" / "effects.xml"
MARGIN, TITLE = 8, 30  # [pixels]
Rgb = NDArray[np.uint8]
Draw = Callable[[Any], Rgb]  # from a frame

OPTICS = {"resolution": (400, 300), "fx": 300.0, "fy": 300.0, "cx": 200.0, "cy": 150.0}
BARREL = rigcast.BrownConrady(k1=-0.35, k2=0.12)
FISHEYE = rigcast.KannalaBrandt(k1=-0.02, k2=0.002)


@dataclass(frozen=True)
class Pair:
    """One picture: a camera with one set of arguments beside it with another, drawn alike."""

    name: str
    titles: tuple[str, str]
    arguments: tuple[dict[str, Any], dict[str, Any]]
    draw: tuple[Draw, Draw]


def depth(frame: rigcast.CameraFrame) -> Rgb:
    """z-depth from red at 0.4 m to violet at 5 m; grey no return, white too near, magenta invalid."""
    return Scale(0.4, 5.0, reverse=True).colours(frame.depth.numpy())


def magnified(frame: rigcast.CameraFrame) -> Rgb:
    """z-depth of the poles and the fan, four times as large."""
    return depth(frame)[60:135, 150:250].repeat(4, axis=0).repeat(4, axis=1)


def infrared(frame: rigcast.CameraFrame) -> Rgb:
    """Infrared intensity in grey, as a camera with an exposure for 2 m shows it."""
    grey = np.sqrt(np.clip(4.0 * frame.intensity.numpy(), 0.0, 1.0))
    return np.repeat((255 * grey).astype(np.uint8)[..., None], 3, axis=-1)


def stereo(**errors: Any) -> dict[str, Any]:
    return {"stereo": rigcast.Stereo(baseline=0.05, **errors)}


def time_of_flight(**errors: Any) -> dict[str, Any]:
    return {"time_of_flight": rigcast.TimeOfFlight(**errors)}


def _pair(name: str, title: str, errors: dict[str, Any], draw: Draw = depth) -> Pair:
    return Pair(name, ("ideal", title), ({}, errors), (draw, draw))


PAIRS = (
    _pair("brown_conrady", "Brown-Conrady, k1 -0.35, k2 0.12", {"distortion": BARREL}),
    _pair("kannala_brandt", "Kannala-Brandt, fx 130", {"distortion": FISHEYE, "fx": 130.0, "fy": 130.0}),
    _pair(
        "disparity_noise",
        "disparity_std 0.1 px, disparity_step 1/8 px",
        stereo(disparity_std=0.1, disparity_step=0.125),
    ),
    _pair("shadow", "shadow of a baseline of 50 mm", stereo(shadow=True)),
    _pair("matching_window", "matching_window 9 px", stereo(matching_window=9), magnified),
    _pair("max_disparity", "max_disparity 25 px: nothing below 0.6 m", stereo(max_disparity=25.0)),
    _pair(
        "losses",
        "min_intensity 0.01, max_incidence 75 deg, dropout 1 %",
        stereo(min_intensity=0.01, max_incidence_deg=75.0, dropout=0.01),
    ),
    _pair("untextured", "untextured_dropout 0.7: only floor and box have texture", stereo(untextured_dropout=0.7)),
    _pair("kinect_v1_nguyen", "first Kinect, Nguyen et al.", stereo(kinect_v1="nguyen")),
    _pair("kinect_v1_disparity", "first Kinect, Barron and Malik", stereo(kinect_v1="disparity")),
    _pair(
        "axial_noise",
        "range_std 50 mm, bias 11 mm + 0.1 %",
        time_of_flight(range_std=0.05, bias=0.011, bias_per_metre=0.001),
    ),
    _pair("flying_pixels", "subrays 5: mean of 5 x 5 ranges", time_of_flight(subrays=5), magnified),
    _pair("range_wrap", "modulation 50 MHz: wraps at 3.0 m", time_of_flight(modulation_hz=50e6)),
    Pair("infrared", ("depth", "infrared intensity"), ({}, {}), (depth, infrared)),
)


def camera(name: str, arguments: dict[str, Any]) -> rigcast.DepthCamera:
    return rigcast.DepthCamera(**{"name": name, "mount": rigcast.Mount(camera="eye"), **OPTICS, **arguments})


def sheet(pictures: tuple[Rgb, Rgb], titles: tuple[str, str]) -> Image.Image:
    """Two pictures of one size side by side, each with its title above."""
    height, width = pictures[0].shape[:2]
    page = Image.new("RGB", (2 * width + 3 * MARGIN, height + TITLE + MARGIN), BACKGROUND)
    draw = ImageDraw.Draw(page)
    for k, (picture, title) in enumerate(zip(pictures, titles, strict=True)):
        left = MARGIN + k * (width + MARGIN)
        draw.text((left, 7), title, fill=FAINT if k == 0 else TEXT, font=font(15))
        page.paste(Image.fromarray(picture), (left, TITLE))
    return page


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("spinning").id)
    sensors = [camera(f"{pair.name}_{k}", pair.arguments[k]) for pair in PAIRS for k in (0, 1)]
    frames = rigcast.Rig(model, sensors).sense(data)
    for pair in PAIRS:
        without, with_it = (pair.draw[k](frames[f"{pair.name}_{k}"]) for k in (0, 1))
        sheet((without, with_it), pair.titles).save(folder / f"{pair.name}.png", optimize=True)
    print(f"{len(PAIRS)} pictures in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else CHECKOUT / "docs" / "sensors")
