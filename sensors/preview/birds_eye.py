"""Points of a lidar seen from above, around the sensor, with rings of distance."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rigcast.sensors.preview.colour import BACKGROUND, GRID, PANEL, TEXT, Rgb, Scale
from rigcast.sensors.preview.page import font, ticks
from rigcast.sensors.preview.panel import draw_squares, empty_panel

MAP_HEIGHT = 640
_MARGIN = 24  # between the points and the edge of the map, pixels


@dataclass(frozen=True)
class _View:
    """The map's view of the ground: `origin` is the pixel (x, y) of the sensor, `pixels` the length of one metre."""

    size: tuple[int, int]
    origin: tuple[float, float]
    pixels: float

    @classmethod
    def around(cls, points: NDArray[np.float32], size: tuple[int, int]) -> "_View":
        """The largest view of the sensor and of the middle 98 % of the points along x and along y."""
        low, high = np.array([-0.5, -0.5]), np.array([0.5, 0.5])
        if points.size:
            low = np.minimum(low, np.percentile(points[:, :2], 1.0, axis=0))
            high = np.maximum(high, np.percentile(points[:, :2], 99.0, axis=0))
        (up, left), (middle_up, middle_left) = high - low, (high + low) / 2
        pixels = float(min((size[0] - 2 * _MARGIN) / left, (size[1] - 2 * _MARGIN) / up))
        origin = (size[0] / 2 + middle_left * pixels, size[1] / 2 + middle_up * pixels)
        return cls(size, (float(origin[0]), float(origin[1])), pixels)

    def reach(self) -> float:
        """Distance from the sensor to the farthest edge of the map [m]."""
        (x, y), (width, height) = self.origin, self.size
        return max(x, y, width - x, height - y) / self.pixels


def draw_map(points: NDArray[np.float32], scale: Scale, size: tuple[int, int]) -> Image.Image:
    """Draw points (n, 3) [m] in the sensor's frame, x up and y to the left, coloured by height z."""
    view = _View.around(points, size)
    canvas = empty_panel(size)
    _draw_points(canvas, points, scale, view)
    image = Image.fromarray(canvas)
    draw = ImageDraw.Draw(image)
    _draw_rings(draw, view)
    x, y = view.origin
    draw.polygon([(x, y - 12), (x - 8, y + 9), (x, y + 4), (x + 8, y + 9)], fill=TEXT, outline=BACKGROUND)
    return image


def _draw_points(canvas: Rgb, points: NDArray[np.float32], scale: Scale, view: _View) -> None:
    """Draw each point as a small square, the higher ones over the lower."""
    points = points[np.argsort(points[:, 2], kind="stable")]
    row = np.round(view.origin[1] - view.pixels * points[:, 0]).astype(np.int64)
    column = np.round(view.origin[0] - view.pixels * points[:, 1]).astype(np.int64)
    draw_squares(canvas, row, column, scale.colours(points[:, 2]), 2 if len(points) > 10_000 else 3)


def _draw_rings(draw: ImageDraw.ImageDraw, view: _View) -> None:
    x, y = view.origin
    for radius, label in ticks(0.0, view.reach(), 5):
        if radius > 0.0:
            r = radius * view.pixels
            draw.ellipse([x - r, y - r, x + r, y + r], outline=GRID)
            for place in _label_places(view, r):
                box = draw.textbbox(place, f"{label} m", font=font(16), anchor="mm")
                if min(box[:2]) >= 0 and box[2] <= view.size[0] and box[3] <= view.size[1]:
                    draw.rectangle((box[0] - 3, box[1] - 3, box[2] + 3, box[3] + 3), fill=PANEL)
                    draw.text(place, f"{label} m", fill=TEXT, font=font(16), anchor="mm")
                    break


def _label_places(view: _View, r: float) -> Iterator[tuple[float, float]]:
    """Points on a ring of `r` pixels, the likeliest to be free first: right and back, then all around."""
    for degrees in (-45, 45, -90, 90, -20, 20, -135, 135, -160, 160, 0, 180):
        angle = np.deg2rad(degrees)
        yield view.origin[0] + r * float(np.cos(angle)), view.origin[1] - r * float(np.sin(angle))
