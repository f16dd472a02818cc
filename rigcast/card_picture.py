"""The picture of a preset: its rays over azimuth and elevation, with its figures; as an image and for a terminal."""

import textwrap

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rigcast.card import Card
from rigcast.sensors.preview.colour import FAINT, GRID, TEXT, Colour, Scale
from rigcast.sensors.preview.page import BAR_SPACE, CAPTION_HEIGHT, MARGIN, TITLE_HEIGHT, WIDTH, Page, ticks
from rigcast.sensors.preview.panel import empty_panel

_BOX = (WIDTH - 2 * MARGIN - BAR_SPACE - 40, 400)
_FEW = 60_000  # most rays that are drawn two pixels wide; the margin is wider than that
_LINE = 23  # pixels from one line of text to the next
_COLUMNS, _ROWS = 76, 18  # characters of a picture in a terminal
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # of a braille character, from U+2800


def draw_card(card: Card) -> Image.Image:
    """Draw a card, 1200 pixels wide: rays coloured by their time of firing, then figures, source and assumptions."""
    lines = _lines(card)
    top = TITLE_HEIGHT + CAPTION_HEIGHT + 8
    page = Page(top + _BOX[1] + 64 + _LINE * len(lines), card.title, " · ".join(card.summary()[:2]))
    _draw_rays(page, card, MARGIN + 40, top)
    for k, (line, colour) in enumerate(lines):
        page.text(MARGIN, top + _BOX[1] + 48 + k * _LINE, line, size=16, colour=colour)
    return page.image


def terminal_picture(card: Card) -> list[str]:
    """The rays over azimuth (left is left) and elevation, in lines of braille characters."""
    x, y = _places(card, (2 * _COLUMNS, 4 * _ROWS))
    cells = np.zeros((4 * _ROWS, 2 * _COLUMNS), dtype=bool)
    cells[y, x] = True
    blocks = cells.reshape(_ROWS, 4, _COLUMNS, 2).transpose(0, 2, 1, 3)
    return ["".join(chr(0x2800 + code) for code in row) for row in (blocks * _DOTS).sum(axis=(2, 3))]


def _draw_rays(page: Page, card: Card, left: int, top: int) -> None:
    x, y = _places(card, _BOX)
    times = card.pattern.firing_times
    seconds = np.zeros(x.size) if times is None else times.ravel() * 1e3
    scale = Scale(0.0, float(seconds.max()) or np.nan)
    canvas = empty_panel(_BOX)
    side = 2 if x.size < _FEW else 1
    for down, across in np.ndindex(side, side):
        canvas[y - down, x - across] = scale.colours(seconds) if times is not None else FAINT
    page.picture(left, top, canvas, _BOX)
    (west, east), (low, high) = _extent(card)
    for value, label in ticks(low, high, 6):
        row = top + (_BOX[1] - 1) * (high - value) / (high - low)
        page.text(left - 8, row, label, size=15, colour=FAINT, anchor="rm")
        page.draw.line([(left - 5, row), (left, row)], fill=GRID)
    for value, label in ticks(east, west, 12):
        column = left + (_BOX[0] - 1) * (west - value) / (west - east)
        page.text(column, top + _BOX[1] + 8, label, size=15, colour=FAINT, anchor="ma")
        page.draw.line([(column, top + _BOX[1]), (column, top + _BOX[1] + 5)], fill=GRID)
    page.text(left, top - 8, "elevation over azimuth [deg], left is left", size=16, colour=FAINT, anchor="ls")
    if times is not None:
        page.colour_bar(left + _BOX[0] + 14, top, _BOX[1], scale, "fired [ms]")


def _extent(card: Card) -> tuple[tuple[float, float], tuple[float, float]]:
    """Azimuths of the left and right edge, elevations of the lower and upper one [deg], with a margin."""
    azimuth, elevation = card.azimuth_deg, card.elevation_deg
    margins = [max(0.03 * float(np.ptp(angle)), 0.5) for angle in (azimuth, elevation)]
    west, east = float(azimuth.max()) + margins[0], float(azimuth.min()) - margins[0]
    return (west, east), (float(elevation.min()) - margins[1], float(elevation.max()) + margins[1])


def _places(card: Card, size: tuple[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Column and row of each ray on a canvas of `size` (width, height)."""
    (west, east), (low, high) = _extent(card)
    x = (size[0] - 1) * (west - card.azimuth_deg) / (west - east)
    y = (size[1] - 1) * (high - card.elevation_deg) / (high - low)
    return np.rint(x).astype(np.intp), np.rint(y).astype(np.intp)


def _lines(card: Card) -> list[tuple[str, Colour]]:
    assumed = card.preset.all_assumed()
    lines = [(line, FAINT) for line in card.summary()[2:]]
    for key, value in card.figures():
        mark = " (assumed)" if key in assumed else ""
        lines += [(line, TEXT) for line in _wrapped(f"{key}: {value}{mark}")]
    for preset in card.preset.lineage():
        lines += [(line, FAINT) for line in _wrapped(f"source: {preset.source}")]
    for key, why in assumed.items():
        lines += [(line, FAINT) for line in _wrapped(f"assumed: {key}: {why}")]
    return lines


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(" ".join(text.split()), 138, subsequent_indent="    ")
