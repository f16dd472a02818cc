"""A frame as a NumPy archive: every ray, misses included, in the frame's own arrays and shapes."""

from pathlib import Path
from typing import Any

import numpy as np

from rigcast.export.fields import camera_fields, fields_of
from rigcast.sensors.rig.frame import CameraFrame, Frame


def write_npz(path: Path, frame: Frame) -> None:
    """Write one frame to `path`, whatever its suffix. Raises OSError where it cannot be written.

    Keys: `sensor`, `time`, `pose`, every per-ray field that the frame has (points in the sensor frame; `pose` takes
    them to the world), and of a depth camera what `camera_fields` has.
    """
    fields: dict[str, Any] = fields_of(frame)
    if isinstance(frame, CameraFrame):
        fields |= camera_fields(frame)
    with path.open("wb") as file:
        np.savez(file, sensor=frame.sensor, time=frame.time, pose=frame.pose, **fields)
