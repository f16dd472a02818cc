"""Depth cameras' frames as OpenEXR images: every pixel and every attribute exact.

Channels, all (H, W): `Z` z-depth and `range` [m], `normal.X`, `normal.Y`, `normal.Z` (32-bit float; optical
frame), `geom_id`, `body_id` (32-bit unsigned). In Z and range +inf is no return, -inf nearer than the
minimum, NaN invalid; there the normal is 0 and the ids are 4294967295.

Attributes: `sensor`, `units`, `conventions`, `ids` (JSON, see IdTable.json) are strings; `time` [s] is one
float64, `pose` (4x4, sensor in world) and `intrinsics` (3x3) are float64 matrices. A camera with a lens adds
`distortion_model`, "brown_conrady" or "kannala_brandt", and `distortion_k1`... by OpenCV's names, one float64 each.
OpenEXR would round a Python float to float32, so no number is handed over as one. A frame that has them adds the
channels `intensity` (float) and `flex_id`, `skin_id`, `prop_id` (unsigned). Several frames make one file with a part
for each, called by its sensor; their common display window holds the largest.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rigcast.export.fields import fields_of
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


def write_exr(path: Path, frames: CameraFrame | Sequence[CameraFrame], ids: IdTable, compression: str = "zip") -> None:
    """Write one frame, or one of each of several cameras, to `path`, whatever its suffix.

    compression: "none", "rle", "zips", "zip" or "piz". Raises OSError where OpenEXR cannot write.
    """
    frames = [frames] if isinstance(frames, CameraFrame) else frames
    height, width = np.max([frame.depth.shape for frame in frames], axis=0)
    window = (np.array([0, 0], np.int32), np.array([width - 1, height - 1], np.int32))
    parts = [_part(frame, ids, compression, window) for frame in frames]
    try:
        OpenEXR.File(parts).write(str(path))
    except RuntimeError as error:
        raise OSError(str(error)) from error


def _part(frame: CameraFrame, ids: IdTable, compression: str, window: tuple[Any, Any]) -> OpenEXR.Part:
    header = {
        "compression": getattr(OpenEXR, f"{'NO' if compression == 'none' else compression.upper()}_COMPRESSION"),
        "type": OpenEXR.scanlineimage,
        "displayWindow": window,  # all parts of a file must have the same one
        "sensor": frame.sensor,
        "time": np.array([frame.time], dtype=np.float64),
        "pose": np.ascontiguousarray(frame.pose, dtype=np.float64),
        "intrinsics": np.ascontiguousarray(frame.intrinsics, dtype=np.float64),
        "units": "metres, seconds, pixels",
        "conventions": CONVENTIONS,
        "ids": ids.json(),
        **_distortion(frame),
    }
    return OpenEXR.Part(header, _channels(frame), frame.sensor)


def _distortion(frame: CameraFrame) -> dict[str, Any]:
    if frame.lens is None:
        return {}
    coefficients = frame.lens.model_dump(exclude={"type"})
    numbers = {f"distortion_{name}": np.array([value], dtype=np.float64) for name, value in coefficients.items()}
    return {"distortion_model": frame.lens.type, **numbers}


def _channels(frame: CameraFrame) -> dict[str, NDArray[Any]]:
    """The channels of a frame. Normals are copied by component, as OpenEXR silently writes strided arrays wrong."""
    fields = fields_of(frame)
    channels = {"Z": fields["depth"], "range": fields["range"]}
    channels |= {f"normal.{axis}": np.ascontiguousarray(fields["normal"][..., k]) for k, axis in enumerate("XYZ")}
    if "intensity" in fields:
        channels["intensity"] = fields["intensity"]
    ids = ("geom_id", "body_id", "flex_id", "skin_id", "prop_id")
    return channels | {name: fields[name].astype(np.uint32) for name in ids if name in fields}  # -1 is 4294967295
