"""A depth camera's z-depth as a 16-bit greyscale PNG, as from drivers: whole steps, 0 for no depth.

A step is the camera's `depth_scale`. 0 is a miss of any kind, and what is too far for 16 bits. Text chunks: `sensor`,
`depth_scale` [m], `time` [s], `pose` (16 numbers, row by row), `intrinsics` (9).
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, PngImagePlugin

from rigcast.sensors.rig.frame import CameraFrame

MILLIMETRE = 0.001


def write_png(path: Path, frame: CameraFrame) -> None:
    """Write one frame to `path`, whatever its suffix. Raises OSError where it cannot be written."""
    text = PngImagePlugin.PngInfo()
    scale = frame.depth_scale
    numbers = {"depth_scale": [scale], "time": [frame.time], "pose": frame.pose, "intrinsics": frame.intrinsics}
    text.add_text("sensor", frame.sensor)
    for name, values in numbers.items():
        text.add_text(name, " ".join(map(repr, np.asarray(values, dtype=np.float64).ravel().tolist())))
    Image.fromarray(whole_steps(frame.depth.numpy(), scale)).save(path, format="png", pnginfo=text)


def whole_steps(depth: NDArray[np.float32], scale: float) -> NDArray[np.uint16]:
    """z-depth [m] in whole steps of `scale` [m]; 0 where it is not finite, or 65535 steps and more."""
    steps = np.rint(depth.astype(np.float64) / scale)
    fits = np.isfinite(steps) & (steps > 0) & (steps < 65535)
    return np.where(fits, steps, 0).astype(np.uint16)
