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
from rigcast.sensors.preview.panel import draw_squares, empty_panel
from rigcast.sensors.specs.pattern import Pattern, azimuth_elevation

_WIDTH = WIDTH - 2 * MARGIN - BAR_SPACE


def draw_lidar(
    sensor: str, time: float, every: NDArray[np.float32], points: NDArray[np.float32], pattern: Pattern
) -> Image.Image:
    """Draw ranges over azimuth (left is left, the middle forward) and elevation, and points from above.

    With several returns the range image shows the first reported one, and the map shows the points of all.

    every, points: (...) and (..., 3) [m], of every return. pattern: the rays of this reading.
    """
    distance = first_returns(every, pattern)
    is_table = distance.ndim == 2
    height = int(np.clip(distance.shape[0] * 6, 120, 300))
    top = TITLE_HEIGHT + CAPTION_HEIGHT
    below = top + height + 2 * CAPTION_HEIGHT + LEGEND_HEIGHT
    rays = _table_of_rays(*distance.shape) if is_table else f"{distance.size} rays"
    title = f"{sensor} · lidar {rays} · {seconds(time)}"
    page = Page(below + MAP_HEIGHT + MARGIN, title, "range image, and the points from above")
    draw_ranges = _range_image if is_table else _range_scatter
    draw_ranges(page, top, height, distance, pattern)
    page.legend(MARGIN, top + height + CAPTION_HEIGHT + LEGEND_HEIGHT // 2, distance)
    _from_above(page, below, points[np.isfinite(every)])
    return page.image


def _table_of_rays(beams: int, columns: int) -> str:
    return f"{beams} {'beam' if beams == 1 else 'beams'} x {columns} columns"


def first_returns(every: NDArray[np.float32], pattern: Pattern) -> NDArray[np.float32]:
    """The range of each ray of the pattern; with several returns that of the first reported one."""
    return every if every.shape == pattern.shape else every[..., 0]


def _range_image(page: Page, top: int, height: int, distance: NDArray[np.float32], pattern: Pattern) -> None:
    order, azimuth = picture_order(pattern.directions)
    scale = Scale.of(distance, reverse=True)
    page.picture(MARGIN, top, scale.colours(distance)[order], (_WIDTH, height))
    page.text(MARGIN, top - 8, "range, highest beam on top", size=16, colour=FAINT, anchor="ls")
    page.colour_bar(MARGIN + _WIDTH + 14, top, height, scale, "range [m]")
    degrees = np.rad2deg(azimuth)
    for angle in range(-180, 181, 45):
        if degrees.min() - 1.0 <= angle <= degrees.max() + 1.0:
            x = MARGIN + _WIDTH * float(np.interp(-angle, -degrees, np.linspace(0.0, 1.0, degrees.size)))
            page.draw.line([(x, top + height), (x, top + height + 5)], fill=FAINT)
            page.text(x, top + height + 8, f"{angle}°", size=15, colour=FAINT, anchor="ma")


def _range_scatter(page: Page, top: int, height: int, distance: NDArray[np.float32], pattern: Pattern) -> None:
    """Draw each ray as a dot at its azimuth and elevation, scaled to fill the picture."""
    scale = Scale.of(distance, reverse=True)
    azimuth, elevation = (np.rad2deg(angle) for angle in azimuth_elevation(pattern.directions))
    (west, east), (high, low) = ((float(angle.max()), float(angle.min())) for angle in (azimuth, elevation))
    x = np.rint((_WIDTH - 2) * (west - azimuth) / max(west - east, 1e-9)).astype(np.intp)
    y = np.rint((height - 2) * (high - elevation) / max(high - low, 1e-9)).astype(np.intp)
    canvas = empty_panel((_WIDTH, height))
    draw_squares(canvas, y, x, scale.colours(distance), 2)
    page.picture(MARGIN, top, canvas, (_WIDTH, height))
    caption = f"range; azimuth {west:.1f}° to {east:.1f}°, elevation {low:.1f}° to {high:.1f}°"
    page.text(MARGIN, top - 8, caption, size=16, colour=FAINT, anchor="ls")
    page.colour_bar(MARGIN + _WIDTH + 14, top, height, scale, "range [m]")


def picture_order(
    directions: NDArray[np.float64],
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], NDArray[np.float64]]:
    """The index of the ray at each pixel of the picture, and the azimuth of its columns [rad].

    The highest beam is on top, and each beam's rays go from left to right by their own azimuth: beams that are turned
    against each other, as most are, would make jagged edges in order of firing.
    """
    elevation = np.arcsin(np.clip(directions[..., 2], -1.0, 1.0)).mean(axis=1)
    azimuth = np.arctan2(directions[..., 1], directions[..., 0])
    rows = np.argsort(-elevation, kind="stable")[:, None]
    columns = np.argsort(-azimuth, axis=1, kind="stable")[rows[:, 0]]
    return (rows, columns), azimuth[rows, columns][len(rows) // 2]


def _from_above(page: Page, top: int, points: NDArray[np.float32]) -> None:
    scale = Scale.of(points[:, 2])
    page.image.paste(draw_map(points, scale, (_WIDTH, MAP_HEIGHT)), (MARGIN, top))
    page.text(MARGIN, top - 8, "from above, sensor frame: x forward is up", size=16, colour=FAINT, anchor="ls")
    page.colour_bar(MARGIN + _WIDTH + 14, top, MAP_HEIGHT, scale, "height [m]")
