"""A page to draw a preview on: text, pictures, colour bars in metres, and a legend of rays without a range."""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rigcast.sensors.preview.colour import (
    BACKGROUND,
    FAINT,
    GRID,
    INVALID,
    NO_RETURN,
    TEXT,
    TOO_NEAR,
    Colour,
    Rgb,
    Scale,
    turbo,
)

WIDTH = 1200
MARGIN = 24
TITLE_HEIGHT = 84
LEGEND_HEIGHT = 48
BAR_WIDTH = 22
BAR_SPACE = 92
CAPTION_HEIGHT = 28


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)


class Page:
    """An image WIDTH pixels wide, `height` tall, with a title line and a fainter line below it."""

    def __init__(self, height: int, title: str, subtitle: str) -> None:
        self.image = Image.new("RGB", (WIDTH, height), BACKGROUND)
        self.draw = ImageDraw.Draw(self.image)
        self.text(MARGIN, 16, title, size=28)
        self.text(MARGIN, 52, subtitle, size=17, colour=FAINT)

    def text(self, x: float, y: float, text: str, size: int = 17, colour: Colour = TEXT, anchor: str = "la") -> None:
        self.draw.text((x, y), text, fill=colour, font=font(size), anchor=anchor)

    def picture(self, x: int, y: int, rgb: Rgb, size: tuple[int, int]) -> None:
        """Paste an (H, W, 3) picture stretched to `size` (width, height), without mixing pixels."""
        shown = Image.fromarray(np.ascontiguousarray(rgb)).resize(size, Image.Resampling.NEAREST)
        self.image.paste(shown, (x, y))

    def colour_bar(self, x: int, y: int, height: int, scale: Scale, caption: str) -> None:
        """Draw a vertical bar, its low end at the bottom, with labelled ticks in metres and a caption above.

        Without a range of values there is nothing to draw but the caption.
        """
        self.text(x, y - 8, caption, colour=FAINT, size=16, anchor="ls")
        if np.isnan(scale.low):
            self.text(x, y + 4, "(none)", colour=FAINT, size=16)
            return
        ramp = np.linspace(1.0, 0.0, height)
        rgb = turbo(1.0 - ramp if scale.reverse else ramp)[:, None]
        self.picture(x, y, np.repeat(rgb, BAR_WIDTH, axis=1), (BAR_WIDTH, height))
        for value, label in ticks(scale.low, scale.high, max(4, height // 60)):
            row = y + (height - 1) * (scale.high - value) / (scale.high - scale.low)
            self.draw.line([(x + BAR_WIDTH, row), (x + BAR_WIDTH + 6, row)], fill=TEXT, width=2)
            self.text(x + BAR_WIDTH + 11, row, label, anchor="lm")

    def legend(self, x: int, y: int, values: NDArray[np.floating]) -> None:
        """Draw the number of finite `values`, and the colours and shares of those that are not."""
        rays = max(values.size, 1)
        kinds: list[tuple[str, Colour, int]] = [
            ("no return", NO_RETURN, int(np.count_nonzero(values == np.inf))),
            ("too near", TOO_NEAR, int(np.count_nonzero(values == -np.inf))),
            ("invalid", INVALID, int(np.count_nonzero(np.isnan(values)))),
        ]
        hit = values.size - sum(count for _, _, count in kinds)
        left = self._item(x, y, f"{hit:,} of {values.size:,} rays have a range ({100.0 * hit / rays:.1f} %)")
        for label, colour, count in kinds:
            if count:
                self.draw.rectangle([left, y - 9, left + 17, y + 8], fill=colour, outline=GRID)
                left = self._item(left + 26, y, f"{label} {100.0 * count / rays:.1f} %")

    def _item(self, x: int, y: int, text: str) -> int:
        self.text(x, y, text, anchor="lm")
        return x + int(self.draw.textlength(text, font=font(17))) + 34


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round values within [low, high], at most about `most`, with as few digits as their step needs."""
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * min((m for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * 0.999), default=10.0)
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return [(k * step, f"{k * step:.{digits}f}") for k in range(first, last + 1)]


def seconds(time: float) -> str:
    return f"t = {time:.3f} s"
