"""A depth camera's frame as a picture: its depth with a scale, and small its normals and geoms."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rigcast.sensors.preview.colour import FAINT, Scale, id_colours, normal_colours
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

Shown = Literal["depth", "range"]

_MAIN = (720, 640)  # the box that the depth picture is fitted into, pixels
_SMALL_WIDTH = WIDTH - 2 * MARGIN - _MAIN[0] - BAR_SPACE - MARGIN


def depth_or_range(depth: NDArray[np.float32], distance: NDArray[np.float32]) -> tuple[NDArray[np.float32], Shown]:
    """What a picture of z-depths and ranges, both (H, W) [m], shows, and its name: the depths, or the ranges if a lens
    sees behind the camera, where z-depth is negative and says little of what is near."""
    sees_behind = bool(np.any(np.isfinite(depth) & (depth < 0)))
    return (distance, "range") if sees_behind else (depth, "depth")


def draw_camera(
    sensor: str,
    time: float,
    depth: NDArray[np.float32],
    distance: NDArray[np.float32],
    normals: NDArray[np.float32],
    geoms: NDArray[np.int32],
) -> Image.Image:
    """Draw depth_or_range, (H, W) [m], over the 1st to 96th percentile; beside it normals (optical frame), geom ids."""
    rows, columns = depth.shape
    shown, name = depth_or_range(depth, distance)
    width, height = _fit(columns, rows, _MAIN)
    small = _fit(columns, rows, (_SMALL_WIDTH, (height - CAPTION_HEIGHT) // 2))
    top = TITLE_HEIGHT + CAPTION_HEIGHT
    title = f"{sensor} · depth camera {columns} x {rows} · {seconds(time)}"
    page = Page(
        top + height + LEGEND_HEIGHT,
        title,
        f"{'z-depth' if name == 'depth' else name} in metres, near is warm, the farthest 4 % are of one colour",
    )

    scale = Scale.of(shown, reverse=True)
    page.picture(MARGIN, top, scale.colours(shown), (width, height))
    page.colour_bar(MARGIN + width + 14, top, height, scale, f"{name} [m]")
    page.legend(MARGIN, top + height + LEGEND_HEIGHT // 2, shown)

    left, below = WIDTH - MARGIN - small[0], top + height - small[1]
    page.text(left, top - 8, "normals", size=16, colour=FAINT, anchor="ls")
    page.picture(left, top, normal_colours(normals), small)
    seen = np.unique(geoms[geoms >= 0]).size
    page.text(left, below - 8, f"geoms, {seen} in view", size=16, colour=FAINT, anchor="ls")
    page.picture(left, below, id_colours(geoms), small)
    return page.image


def _fit(columns: int, rows: int, box: tuple[int, int]) -> tuple[int, int]:
    """The largest (width, height) within `box` that keeps the pixels square, at least one pixel each way."""
    factor = min(box[0] / columns, box[1] / rows)
    return max(1, round(columns * factor)), max(1, round(rows * factor))
