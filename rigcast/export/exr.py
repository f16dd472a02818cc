"""A depth camera's frame as an OpenEXR image: every pixel and every attribute exact.

Channels, all (H, W): `Z` z-depth and `range` [m], `normal.X`, `normal.Y`, `normal.Z` (32-bit float; optical
frame), `geom_id`, `body_id` (32-bit unsigned). In Z and range +inf is no return, -inf nearer than the
minimum, NaN invalid; there the normal is 0 and the ids are 4294967295.

Attributes: `sensor`, `units`, `conventions`, `ids` (JSON, see IdTable.json) are strings; `time` [s] is one
float64, `pose` (4x4, sensor in world) and `intrinsics` (3x3) are float64 matrices. A camera with a lens adds
`distortion_model`, "brown_conrady" or "kannala_brandt", and `distortion_k1`... by OpenCV's names, one float64 each.
OpenEXR would round a Python float to float32, so no number is handed over as one.
"""

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rigcast.export.ids import IdTable
from rigcast.sensors.rig.frame import CameraFrame

CONVENTIONS = (
    "pose maps the sensor's optical frame (x right, y down, z forward) into the world; "
    "Z is the depth along z, range the distance from the sensor; +inf no return, -inf nearer than the "
    "minimum, NaN invalid; normals are in the optical frame, 0 on a miss; an id of 4294967295 is a miss; "
    "intrinsics count pixels from the top left corner of the image, pixel centres are at +0.5; "
    "distortion_model, if any, is OpenCV's: brown_conrady with distortion_k1 k2 p1 p2 k3 k4 k5 k6, "
    "kannala_brandt (fisheye) with distortion_k1 k2 k3 k4"
)


def write_exr(path: Path, frame: CameraFrame, ids: IdTable) -> None:
    """Write one frame to `path`, whatever its suffix. Raises OSError where OpenEXR cannot write."""
    try:
        OpenEXR.File(_header(frame, ids), _channels(frame)).write(str(path))
    except RuntimeError as error:
        raise OSError(str(error)) from error


def _header(frame: CameraFrame, ids: IdTable) -> dict[str, Any]:
    return {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "sensor": frame.sensor,
        "time": np.array([frame.time], dtype=np.float64),
        "pose": np.ascontiguousarray(frame.pose, dtype=np.float64),
        "intrinsics": np.ascontiguousarray(frame.intrinsics, dtype=np.float64),
        "units": "metres, seconds, pixels",
        "conventions": CONVENTIONS,
        "ids": ids.json(),
        **_distortion(frame),
    }


def _distortion(frame: CameraFrame) -> dict[str, Any]:
    if frame.lens is None:
        return {}
    coefficients = frame.lens.model_dump(exclude={"type"})
    numbers = {f"distortion_{name}": np.array([value], dtype=np.float64) for name, value in coefficients.items()}
    return {"distortion_model": frame.lens.type, **numbers}


def _channels(frame: CameraFrame) -> dict[str, NDArray[Any]]:
    """OpenEXR writes strided arrays wrong without a word, hence the copies of the normal's components."""
    normal = frame.normal.numpy()
    return {
        "Z": np.ascontiguousarray(frame.depth.numpy()),
        "range": np.ascontiguousarray(frame.range.numpy()),
        "normal.X": np.ascontiguousarray(normal[..., 0]),
        "normal.Y": np.ascontiguousarray(normal[..., 1]),
        "normal.Z": np.ascontiguousarray(normal[..., 2]),
        "geom_id": _unsigned(frame.geom_id.numpy()),
        "body_id": _unsigned(frame.body_id.numpy()),
    }


def _unsigned(ids: NDArray[np.int32]) -> NDArray[np.uint32]:
    return np.ascontiguousarray(ids).astype(np.uint32)  # -1 becomes 4294967295
