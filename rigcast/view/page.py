"""A page of HTML that shows readings and needs nothing else: clouds to turn, depth images, a time slider."""

import base64
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rigcast.sensors.errors import InputError
from rigcast.sensors.preview.colour import Scale, id_colours, turbo
from rigcast.view.shots import Shot, sensors_in, values_in

# What a browser can take: most shots, most points of each, pixels of a row of an image (less than twice as many). Who
# makes the shots keeps to these, by Share and Shot.thinned, so as to have no more in memory.
MOST_SHOTS, MOST_POINTS, WIDEST = 200, 20_000, 320
_FARTHEST = 5.0
_STEPS = 65535  # of an unsigned 16-bit coordinate


def write_page(path: Path, title: str, shots: Sequence[Shot]) -> None:
    """Write a page that shows the shots; it opens from disk in any browser.

    Points more than _FARTHEST times as far from the middle as most are left out, so that the others stay exact.

    Raises InputError without a shot, OSError where the file cannot be written.
    """
    if not shots:
        raise InputError(f"{title}: no frame to show")
    template = (files("rigcast.view") / "page.html").read_text(encoding="utf-8")
    document = _document(title, sorted(shots, key=lambda shot: shot.time))
    # "</" would end the script that the data are in
    data = json.dumps(document, allow_nan=False).replace("</", "<\\/")
    path.write_text(template.replace("/*DATA*/null", data), encoding="utf-8")


def _document(title: str, shots: Sequence[Shot]) -> dict[str, Any]:
    box = _Box.of([shot.points_world for shot in shots])
    scales = {name: _scale(name, shots) for name in values_in(shots)}
    images = [shot.image.ravel() for shot in shots if shot.image is not None]
    depth = Scale.of(np.concatenate([np.empty(0), *images]), reverse=True)
    return {
        "title": title,
        "low": box.low.tolist(),
        "step": ((box.high - box.low) / _STEPS).tolist(),
        "middle": (box.middle - box.low).tolist(),
        "reach": box.reach,
        "sensors": sensors_in(shots),
        "scales": scales,
        "ids": id_colours(np.arange(256)).tolist(),
        "turbo": turbo(np.linspace(0, 1, 256)).tolist(),
        "depth": [depth.low, depth.high] if np.isfinite(depth.low) else None,
        "shots": [_entry(shot, box, scales, depth) for shot in shots],
    }


@dataclass(frozen=True)
class _Box:
    """The box [m] in which points are shown, and the distance from its middle within which nine in ten points are."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    middle: NDArray[np.float64]
    reach: float

    @staticmethod
    def of(clouds: Sequence[NDArray[np.float64]]) -> "_Box":
        points = np.concatenate(clouds) if any(map(len, clouds)) else np.zeros((1, 3))
        middle = np.median(points, axis=0)
        reach = float(np.percentile(np.linalg.norm(points - middle, axis=1), 90)) + 0.1
        low = np.maximum(points.min(axis=0), middle - _FARTHEST * reach)
        high = np.minimum(points.max(axis=0), middle + _FARTHEST * reach)
        return _Box(low, np.maximum(high, low + 1e-6), middle, reach)

    def steps(self, points: NDArray[np.float64]) -> NDArray[np.uint16]:
        """Points (n, 3) in the box as integers from 0 to _STEPS along each axis."""
        return np.round((points - self.low) / (self.high - self.low) * _STEPS).astype("<u2")

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.all((points >= self.low) & (points <= self.high), axis=1)


def _scale(name: str, shots: Sequence[Shot]) -> list[float] | None:
    """The values at both ends of the colour scale; None for ids, which have a colour each."""
    if name == "geom_id":
        return None
    scale = Scale.of(np.concatenate([np.asarray(s.values[name], float) for s in shots if name in s.values]))
    ends = [scale.low, scale.high] if np.isfinite(scale.low) else [0.0, 1.0]
    return ends[::-1] if name == "range" else ends  # near is warm


def _entry(shot: Shot, box: _Box, scales: dict[str, list[float] | None], depth: Scale) -> dict[str, Any]:
    cloud = shot.points_world
    shown = box.holds(cloud)
    entry: dict[str, Any] = {
        "sensor": shot.sensor,
        "time": shot.time,
        "origin": shot.pose[:3, 3].tolist(),
        "points": _packed(box.steps(cloud[shown])),
        "values": {name: _packed(_bytes(shot.values[name][shown], scales[name])) for name in shot.values},
    }
    if shot.image is not None:
        entry["image"], entry["shows"] = _picture(shot.image, depth), shot.shows
        entry["size"] = shot.size
    return entry


def _bytes(values: NDArray[Any], scale: list[float] | None) -> NDArray[np.uint8]:
    """Values as 0 to 255 along the scale; ids modulo 256."""
    if scale is None:
        return (values.astype(np.int64) % 256).astype(np.uint8)
    return np.clip((values - scale[0]) / (scale[1] - scale[0]) * 255, 0, 255).astype(np.uint8)


def _picture(image: NDArray[np.float32], scale: Scale) -> str:
    rgb = scale.colours(image)
    png = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgb)).save(png, format="png")
    return "data:image/png;base64," + base64.b64encode(png.getvalue()).decode()


def _packed(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
