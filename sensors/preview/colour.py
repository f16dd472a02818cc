"""Colours for depths, heights, ids, normals, and rays without a range."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]
Rgb = NDArray[np.uint8]

BACKGROUND: Colour = (19, 21, 26)
PANEL: Colour = (30, 33, 40)
TEXT: Colour = (232, 234, 238)
FAINT: Colour = (150, 155, 165)
GRID: Colour = (88, 93, 104)

NO_RETURN: Colour = (96, 99, 105)
TOO_NEAR: Colour = (255, 255, 255)
INVALID: Colour = (255, 80, 200)

# Turbo, an improved rainbow colour map by A. Mikhailov, in the polynomial fit by R. Du, within some 20 of 255 of
# the map's table. Copyright 2019 Google LLC, Apache-2.0:
# https://gist.github.com/mikhailov-work/0d177465a8151eb6ede1768d51d476c7
# One row per power of t, from t^0 to t^5; columns red, green, blue.
_TURBO = np.array(
    [
        [0.13572138, 0.09140261, 0.10667330],
        [4.61539260, 2.19418839, 12.64194608],
        [-42.66032258, 4.84296658, -60.58204836],
        [132.13108234, -14.18503333, 110.36276771],
        [-152.94239396, 4.27729857, -89.90310912],
        [59.28637943, 2.82956604, 27.34824973],
    ]
)


def turbo(t: NDArray[np.floating]) -> Rgb:
    """Colours (..., 3) of values in [0, 1], violet over green to red; others are clamped, NaN is 0."""
    # Both ends of Turbo are nearly black: leaving them out keeps the values there apart from the background.
    x = 0.06 + 0.88 * np.clip(np.nan_to_num(t), 0.0, 1.0)[..., None]
    rgb = np.zeros((*t.shape, 3))
    for coefficients in _TURBO[::-1]:
        rgb = rgb * x + coefficients
    return np.round(255.0 * np.clip(rgb, 0.0, 1.0)).astype(np.uint8)


@dataclass(frozen=True)
class Scale:
    """A range of values [m] mapped to the colours; NaN to NaN if there is none.

    `reverse` gives the low end the warm colours.
    """

    low: float
    high: float
    reverse: bool = False

    @classmethod
    def of(cls, values: NDArray[np.floating], reverse: bool = False) -> "Scale":
        """The range from the 1st to the 96th percentile of finite values, to leave out views through doors."""
        finite = values[np.isfinite(values)]
        if not finite.size:
            return cls(np.nan, np.nan, reverse)
        low, high = (float(value) for value in np.percentile(finite, [1.0, 96.0]))
        if high - low < 1e-6 * max(abs(low), abs(high), 1.0):
            return cls(low - 0.5, high + 0.5, reverse)
        return cls(low, high, reverse)

    def colours(self, values: NDArray[np.floating]) -> Rgb:
        """Colours (..., 3) of values; NO_RETURN, TOO_NEAR and INVALID for +inf, -inf and NaN."""
        finite = np.isfinite(values)
        t = (np.where(finite, values, self.low).astype(np.float64) - self.low) / (self.high - self.low)
        rgb = turbo(1.0 - t if self.reverse else t)
        rgb[values == np.inf] = NO_RETURN
        rgb[values == -np.inf] = TOO_NEAR
        rgb[np.isnan(values)] = INVALID
        return rgb


def id_colours(ids: NDArray[np.integer]) -> Rgb:
    """Colours (..., 3) far apart for neighbouring ids; NO_RETURN where negative."""
    # Steps of the golden ratio around the hue circle, and two other irrational ones, keep ids distinct.
    hue = np.mod(ids * 0.61803399, 1.0)
    saturation = 0.45 + 0.4 * np.mod(ids * 0.41421356, 1.0)
    value = 0.65 + 0.35 * np.mod(ids * 0.73205081, 1.0)
    corner = np.mod(hue[..., None] * 6.0 + np.array([5.0, 3.0, 1.0]), 6.0)
    chroma = np.clip(np.minimum(corner, 4.0 - corner), 0.0, 1.0)
    rgb = value[..., None] * (1.0 - saturation[..., None] * chroma)
    colours: Rgb = np.round(255.0 * rgb).astype(np.uint8)
    colours[ids < 0] = NO_RETURN
    return colours


def normal_colours(normals: NDArray[np.floating]) -> Rgb:
    """Colours (..., 3) of unit normals in the optical frame: red right, green up, blue towards the camera."""
    shown = 0.5 + 0.5 * normals * np.array([1.0, -1.0, -1.0])
    colours: Rgb = np.round(255.0 * np.clip(np.nan_to_num(shown), 0.0, 1.0)).astype(np.uint8)
    colours[~np.any(normals != 0.0, axis=-1)] = NO_RETURN
    return colours
