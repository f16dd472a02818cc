"""A lidar's frame as a picture: its range image above its points seen from the top."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rigcast.sensors.preview.birds_eye import MAP_HEIGHT, draw_map
from rigcast.sensors.preview.colour import FAINT, Scale
from rigcast.sensors.preview.page import (
    BAR_SPACE,
    CAPTION_HEIGHT,
    LEGEND_HEIGHT,
    MARGIN,
    TITLE_HEIGHT,
    WIDTH,
    Page,
    seconds,
)
from rigcast.sensors.rig.frame import LidarFrame
from rigcast.sensors.specs.pattern import Pattern

_WIDTH = WIDTH - 2 * MARGIN - BAR_SPACE


def draw_lidar(frame: LidarFrame, pattern: Pattern) -> Image.Image:
    """Draw ranges over azimuth (left is left, the middle forward) and elevation, and points from above."""
    distance = frame.range.numpy()
    beams, columns = distance.shape
    height = int(np.clip(beams * 6, 120, 300))
    top = TITLE_HEIGHT + CAPTION_HEIGHT
    below = top + height + 2 * CAPTION_HEIGHT + LEGEND_HEIGHT
    title = f"{frame.sensor} · lidar {beams} beams x {columns} columns · {seconds(frame.time)}"
    page = Page(below + MAP_HEIGHT + MARGIN, title, "range image, and the points from above")
    _range_image(page, top, height, distance, pattern)
    page.legend(MARGIN, top + height + CAPTION_HEIGHT + LEGEND_HEIGHT // 2, distance)
    _from_above(page, below, frame.points.numpy()[np.isfinite(distance)])
    return page.image


def _range_image(page: Page, top: int, height: int, distance: NDArray[np.float32], pattern: Pattern) -> None:
    rows, columns, azimuth = picture_order(pattern.directions)
    scale = Scale.of(distance, reverse=True)
    page.picture(MARGIN, top, scale.colours(distance)[np.ix_(rows, columns)], (_WIDTH, height))
    page.text(MARGIN, top - 8, "range, highest beam on top", size=16, colour=FAINT, anchor="ls")
    page.colour_bar(MARGIN + _WIDTH + 14, top, height, scale, "range [m]")
    degrees = np.rad2deg(azimuth)
    for angle in range(-180, 181, 45):
        if degrees.min() - 1.0 <= angle <= degrees.max() + 1.0:
            x = MARGIN + _WIDTH * float(np.interp(-angle, -degrees, np.linspace(0.0, 1.0, degrees.size)))
            page.draw.line([(x, top + height), (x, top + height + 5)], fill=FAINT)
            page.text(x, top + height + 8, f"{angle}°", size=15, colour=FAINT, anchor="ma")


def picture_order(
    directions: NDArray[np.float64],
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Rows from the highest beam down, columns from left to right, and the azimuth of those columns [rad]."""
    elevation = np.arcsin(np.clip(directions[..., 2], -1.0, 1.0)).mean(axis=1)
    middle = directions[directions.shape[0] // 2]
    azimuth = np.arctan2(middle[:, 1], middle[:, 0])
    columns = np.argsort(-azimuth, kind="stable")
    return np.argsort(-elevation, kind="stable"), columns, azimuth[columns]


def _from_above(page: Page, top: int, points: NDArray[np.float32]) -> None:
    scale = Scale.of(points[:, 2])
    page.image.paste(draw_map(points, scale, (_WIDTH, MAP_HEIGHT)), (MARGIN, top))
    page.text(MARGIN, top - 8, "from above, sensor frame: x forward is up", size=16, colour=FAINT, anchor="ls")
    page.colour_bar(MARGIN + _WIDTH + 14, top, MAP_HEIGHT, scale, "height [m]")
