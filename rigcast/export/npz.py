"""A frame as a NumPy archive: every ray, misses included, in the frame's own arrays and shapes."""

from pathlib import Path

import numpy as np

from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame

_EVERY_FRAME = ("range", "points", "normal", "geom_id", "body_id", "stamp")


def write_npz(path: Path, frame: Frame) -> None:
    """Write one frame to `path`, whatever its suffix. Raises OSError where it cannot be written.

    Keys: `sensor`, `time`, `pose`, the per-ray fields of Frame (points in the sensor frame; `pose` takes them
    to the world), and `ring`, `column` of a lidar or `depth`, `intensity`, `depth_16bit`, `depth_scale`, `intrinsics`
    and, with a lens, `distortion_model` and `distortion` (OpenCV's order) of a depth camera.
    """
    fields = {name: getattr(frame, name).numpy() for name in _EVERY_FRAME}
    if isinstance(frame, LidarFrame):
        fields |= {"ring": frame.ring.numpy(), "column": frame.column.numpy()}
    if isinstance(frame, CameraFrame):
        fields |= {name: getattr(frame, name).numpy() for name in ("depth", "depth_16bit", "intensity")}
        fields |= {"depth_scale": np.float64(frame.depth_scale), "intrinsics": frame.intrinsics}
        if frame.lens is not None:
            fields |= {"distortion_model": np.str_(frame.lens.type), "distortion": frame.lens.coefficients}
    with path.open("wb") as file:
        np.savez(file, sensor=frame.sensor, time=frame.time, pose=frame.pose, **fields)
