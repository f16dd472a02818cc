"""A depth camera's z-depth as a 16-bit greyscale PNG: whole millimetres, 0 where there is none.

0 is a miss of any kind, and what is at 65.535 m or farther (REP-118's 16UC1; what RealSense and Kinect drivers
give). Text chunks: `sensor`, `time` [s], `pose` (16 numbers, row by row), `intrinsics` (9), `unit` "0.001 m".
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, PngImagePlugin

from rigcast.sensors.rig.frame import CameraFrame


def write_png(path: Path, frame: CameraFrame) -> None:
    """Write one frame to `path`, whatever its suffix. Raises OSError where it cannot be written."""
    text = PngImagePlugin.PngInfo()
    numbers = {"time": [frame.time], "pose": frame.pose, "intrinsics": frame.intrinsics}
    text.add_text("sensor", frame.sensor)
    text.add_text("unit", "0.001 m")
    for name, values in numbers.items():
        text.add_text(name, " ".join(map(repr, np.asarray(values, dtype=np.float64).ravel().tolist())))
    Image.fromarray(millimetres(frame.depth.numpy())).save(path, format="png", pnginfo=text)


def millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """z-depth [m] in whole millimetres; 0 where it is not finite, or 65.535 m and more."""
    whole = np.rint(1000.0 * depth.astype(np.float64))
    fits = np.isfinite(whole) & (whole > 0) & (whole < 65535)
    return np.where(fits, whole, 0).astype(np.uint16)
