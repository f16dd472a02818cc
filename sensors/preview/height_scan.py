"""A height scan's frame as a picture: the grid from above, coloured by height."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rigcast.sensors.preview.colour import Scale
from rigcast.sensors.preview.page import CAPTION_HEIGHT, LEGEND_HEIGHT, MARGIN, TITLE_HEIGHT, Page, seconds
from rigcast.sensors.specs.pattern import Pattern

_BOX = (940, 640)  # what the grid is fitted into, pixels


def draw_height_scan(
    sensor: str, time: float, distance: NDArray[np.float32], points: NDArray[np.float32], pattern: Pattern
) -> Image.Image:
    """Draw the height of the hits in the sensor's frame, x forward up, y to the left.

    distance, points: (rays,) and (rays, 3) [m], of the rays of the pattern.
    """
    height = np.where(np.isfinite(distance), points[:, 2], distance)
    grid, extent = _grid(pattern, height)
    rows, columns = grid.shape
    cell = max(1, min(_BOX[0] // columns, _BOX[1] // rows))
    size = (columns * cell, rows * cell)
    top = TITLE_HEIGHT + CAPTION_HEIGHT
    page_height = top + max(size[1], 200) + CAPTION_HEIGHT + LEGEND_HEIGHT
    title = f"{sensor} · height scan {rows} x {columns} · {seconds(time)}"
    where = f"x forward is up ({extent[0]:.2f} m), y to the left ({extent[1]:.2f} m)"
    subtitle = f"height of the ground in the sensor's frame, from above: {where}"
    page = Page(page_height, title, subtitle)
    scale = Scale.of(height)
    page.picture(MARGIN, top, scale.colours(grid), size)
    page.colour_bar(MARGIN + size[0] + 14, top, max(size[1], 200), scale, "height [m]")
    page.legend(MARGIN, page_height - LEGEND_HEIGHT // 2, distance)
    return page.image


def _grid(pattern: Pattern, values: NDArray[np.floating]) -> tuple[NDArray[np.floating], tuple[float, float]]:
    """`values` of the rays by where the rays start: rows from front to back, columns from left to right.

    Also how far the grid reaches along x and y [m]. Positions are compared to a micrometre.
    """
    if pattern.origins is None:
        raise ValueError("a height scan needs a pattern with origins")
    start = pattern.origins.reshape(-1, 3).round(6)
    x, row = np.unique(-start[:, 0], return_inverse=True)
    y, column = np.unique(-start[:, 1], return_inverse=True)
    grid = np.full((x.size, y.size), np.nan)
    grid[row, column] = values
    return grid, (float(np.ptp(x)), float(np.ptp(y)))
