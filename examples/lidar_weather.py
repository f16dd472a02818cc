"""How far a lidar sees in rain and in fog, as two diagrams: by its formula, and measured in a simulation.

python examples/lidar_weather.py [FOLDER]     writes FOLDER/lidar_weather.png, by default to docs/sensors

The lidar just detects 10 % at 60 m. A curve is the R at which rho exp(-2 a R) / R^2 = 0.1 / 60^2, a dot the largest
sphere around the sensor of which a return comes back, found by halving.
"""

import math
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image, ImageDraw

import rigcast
from rigcast.kernels.effects.lidars.weather import fog_extinction, rain_extinction
from rigcast.sensors.preview.colour import BACKGROUND, FAINT, GRID, TEXT, Scale
from rigcast.sensors.preview.page import font

RANGE = 60.0
FARTHEST = 200.0  # upper end of the diagrams [m]
REFLECTIVITIES = (0.1, 0.3, 0.9)
RATES = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)  # [mm/h]
VISIBILITIES = (10.0, 25.0, 50.0, 100.0, 250.0, 1000.0)  # [m], on a logarithmic axis
PLOT = (60, 40, 400, 260)  # left, top, width, height within a panel [pixels]
PANEL = (490, 350)


def detection_range(reflectivity: float, extinction: float) -> float:
    """Where rho exp(-2 a R) / R^2 falls to the least power, by halving [m]."""
    near, far = 0.0, 1000.0
    for _ in range(60):
        middle = 0.5 * (near + far)
        is_seen = reflectivity * math.exp(-2 * extinction * middle) / middle**2 >= 0.1 / RANGE**2
        near, far = (middle, far) if is_seen else (near, middle)
    return near


def measured_range(reflectivity: float, weather: rigcast.Weather) -> float:
    """The largest sphere that a simulated lidar sees from within [m], by halving."""
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom name="sphere" size="1"/></worldbody></mujoco>')
    lidar = rigcast.Lidar(
        name="top",
        mount=rigcast.Mount(),
        elevation_deg=[0],
        columns=1,
        detection=rigcast.Detection(range=RANGE),
        weather=weather,
        returns="last",
    )
    rig = rigcast.Rig(model, [lidar], surfaces=[rigcast.Surface(geom="sphere", reflectivity=reflectivity)])
    near, far = 0.0, 1000.0
    for _ in range(24):
        model.geom_size[0] = 0.5 * (near + far)
        is_seen = rig.sense(mujoco.MjData(model))["top"].geom_id.numpy().item() == 0
        near, far = (model.geom_size[0, 0], far) if is_seen else (near, model.geom_size[0, 0])
    return near


def rain_across(rate: float) -> float:
    return rate / RATES[-1]


def fog_across(visibility: float) -> float:
    return math.log(visibility / VISIBILITIES[0]) / math.log(VISIBILITIES[-1] / VISIBILITIES[0])


def _place(across: float, distance: float) -> tuple[float, float]:
    left, top, width, height = PLOT
    return left + width * across, top + height * (1 - distance / FARTHEST)


def _axes(draw: ImageDraw.ImageDraw, title: str, ticks: dict[str, float]) -> None:
    left, top, width, height = PLOT
    draw.text((left, 10), title, fill=TEXT, font=font(15))
    for distance in range(0, int(FARTHEST) + 1, 50):
        y = _place(0, distance)[1]
        draw.line([(left, y), (left + width, y)], fill=GRID)
        draw.text((left - 8, y), f"{distance} m", fill=FAINT, font=font(13), anchor="rm")
    for label, across in ticks.items():
        draw.text((_place(across, 0)[0], top + height + 8), label, fill=FAINT, font=font(13), anchor="ma")


def panel(title: str, ticks: dict[str, float], lines: list[dict[str, Any]]) -> Image.Image:
    image = Image.new("RGB", PANEL, BACKGROUND)
    draw = ImageDraw.Draw(image)
    _axes(draw, title, ticks)
    for k, line in enumerate(lines):
        colour = tuple(int(c) for c in Scale(0.0, 1.0).colours(np.array([0.15 + 0.35 * k]))[0])
        draw.line([_place(*point) for point in line["curve"]], fill=colour, width=2)
        for x, y in (_place(*point) for point in line["dots"]):
            draw.ellipse([x - 4, y - 4, x + 4, y + 4], fill=colour)
        draw.text(
            (PLOT[0] + 300, PLOT[1] + 6 + 18 * k), f"{100 * line['reflectivity']:.0f} %", fill=colour, font=font(15)
        )
    return image


def rain_panel() -> Image.Image:
    lines = [
        {
            "reflectivity": rho,
            "curve": [(rain_across(r), detection_range(rho, rain_extinction(r))) for r in np.linspace(0, 50, 101)],
            "dots": [(rain_across(r), measured_range(rho, rigcast.Weather(rain_rate=r))) for r in RATES],
        }
        for rho in REFLECTIVITIES
    ]
    return panel("detection range in rain [mm/h]", {f"{r:.0f}": rain_across(r) for r in RATES}, lines)


def fog_panel() -> Image.Image:
    lines = [
        {
            "reflectivity": rho,
            "curve": [(fog_across(v), detection_range(rho, fog_extinction(v))) for v in np.geomspace(10, 1000, 101)],
            "dots": [(fog_across(v), measured_range(rho, rigcast.Weather(visibility=v))) for v in VISIBILITIES],
        }
        for rho in REFLECTIVITIES
    ]
    return panel("detection range in fog, by visibility [m]", {f"{v:.0f}": fog_across(v) for v in VISIBILITIES}, lines)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    page = Image.new("RGB", (2 * PANEL[0], PANEL[1]), BACKGROUND)
    page.paste(rain_panel(), (0, 0))
    page.paste(fog_panel(), (PANEL[0], 0))
    page.save(folder / "lidar_weather.png", optimize=True)
    print(f"1 picture in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1] / "docs" / "sensors")
