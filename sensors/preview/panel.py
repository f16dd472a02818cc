"""Empty panels, and squares of colour on them."""

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.preview.colour import PANEL, Rgb


def empty_panel(size: tuple[int, int]) -> Rgb:
    """A panel (height, width, 3) of `size` (width, height)."""
    return np.tile(np.array(PANEL, dtype=np.uint8), (size[1], size[0], 1))


def draw_squares(panel: Rgb, row: NDArray[np.integer], column: NDArray[np.integer], colours: Rgb, side: int) -> None:
    """Draw squares of `side` pixels, down and right from each place, clipped to the panel; later ones on top."""
    height, width = panel.shape[:2]
    for down, across in np.ndindex(side, side):
        y, x = row + down, column + across
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        panel[y[inside], x[inside]] = colours[inside]
