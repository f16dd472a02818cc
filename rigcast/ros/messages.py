"""ROS 2 messages of what a frame holds, as objects of rosbags' types.

Times are those of the simulation. Frames of reference: REP-103, cameras in their optical frame; ranges and depths
by REP-117 and REP-118 (+inf no return, -inf too near, NaN invalid; 0 in 16UC1).
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcast.export.fields import fields_of
from rigcast.export.frames.png import MILLIMETRE, whole_steps
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.rotations import quaternion
from rigcast.sensors.specs.lens import Lens
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .layouts import Points

_SCAN = ("range", "stamp", "intensity")
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}  # of PointField


@cache
def typestore() -> Any:
    """The definitions of messages, those of ROS 2 Jazzy; the ones used here are the same from Humble on."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def make(kind: str, *values: Any) -> Any:
    """A message of a kind such as "sensor_msgs/msg/Image"."""
    return typestore().types[kind](*values)


def nanoseconds(time: float) -> int:
    """Simulation time [s] in whole nanoseconds."""
    whole = math.floor(time)  # apart: a float64 of 1e18 ns would be off by up to 128 ns
    return 10**9 * whole + round((time - whole) * 1e9)


def stamp(time: float) -> Any:
    """builtin_interfaces/Time."""
    return make("builtin_interfaces/msg/Time", *divmod(nanoseconds(time), 10**9))


def header(time: float, frame_id: str) -> Any:
    """std_msgs/Header."""
    return make("std_msgs/msg/Header", stamp(time), frame_id)


def point_cloud(time: float, frame_id: str, points: Points) -> Any:
    """sensor_msgs/PointCloud2 of a structured array (height, width)."""
    array, dense = points
    fields = [
        make("sensor_msgs/msg/PointField", name, offset, DATATYPES[kind.str[1:]], 1)
        for name, (kind, offset, *_) in (array.dtype.fields or {}).items()
    ]
    height, width = array.shape
    step = array.dtype.itemsize
    data = np.frombuffer(np.ascontiguousarray(array).tobytes(), np.uint8)
    kind = "sensor_msgs/msg/PointCloud2"
    return make(kind, header(time, frame_id), height, width, fields, False, step, step * width, data, dense)


def laser_scan(frame: Frame, frame_id: str, angles: NDArray[np.float64], spec: SensorSpec) -> Any:
    """sensor_msgs/LaserScan of a scanner whose rays are at evenly spaced `angles` [rad].

    Of several returns the first in the frame.
    """
    count = len(angles)
    fields = {name: field.reshape(count, -1)[:, 0].copy() for name, field in fields_of(frame).items() if name in _SCAN}
    fired = fields["stamp"]
    return make(
        "sensor_msgs/msg/LaserScan",
        header(frame.time, frame_id),
        angles[0],
        angles[-1],
        (angles[-1] - angles[0]) / max(count - 1, 1),
        (fired[-1] - fired[0]) / max(count - 1, 1),
        0.0 if spec.rate_hz is None else 1.0 / spec.rate_hz,
        spec.min_range,
        spec.max_range,
        fields["range"],
        fields.get("intensity", np.zeros(0, np.float32)),
    )


def depth_image(frame: CameraFrame, frame_id: str, encoding: str) -> Any:
    """sensor_msgs/Image of the z-depth: 32FC1 in metres or 16UC1 in millimetres."""
    depth = frame.depth.numpy()
    pixels = depth.astype("<f4") if encoding == "32FC1" else whole_steps(depth, MILLIMETRE).astype("<u2")
    height, width = pixels.shape
    data = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
    step = width * pixels.itemsize
    return make("sensor_msgs/msg/Image", header(frame.time, frame_id), height, width, encoding, False, step, data)


def camera_info(frame: CameraFrame, frame_id: str) -> Any:
    """sensor_msgs/CameraInfo, where the centre of the first pixel is at (0, 0): ours is at (0.5, 0.5)."""
    matrix = frame.intrinsics - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    model, distortion = _distortion(frame.lens)
    height, width = frame.shape[:2]
    return make(
        "sensor_msgs/msg/CameraInfo",
        header(frame.time, frame_id),
        height,
        width,
        model,
        distortion,
        matrix.ravel(),
        np.eye(3).ravel(),
        np.hstack([matrix, np.zeros((3, 1))]).ravel(),
        0,
        0,
        make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False),
    )


def transforms(time: float, poses: Mapping[tuple[str, str], NDArray[np.float64]]) -> Any:
    """tf2_msgs/TFMessage of (4, 4) poses by (parent, child)."""
    return make(
        "tf2_msgs/msg/TFMessage",
        [
            make("geometry_msgs/msg/TransformStamped", header(time, parent), child, _transform(pose))
            for (parent, child), pose in poses.items()
        ],
    )


def text(line: str) -> Any:
    """std_msgs/String."""
    return make("std_msgs/msg/String", line)


def clock(time: float) -> Any:
    """rosgraph_msgs/Clock."""
    return make("rosgraph_msgs/msg/Clock", stamp(time))


def serialize(message: Any) -> bytes:
    """The message as CDR, with its header, as bags hold it and rclpy publishes it."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def _distortion(lens: Lens | None) -> tuple[str, NDArray[np.float64]]:
    """ROS's name of the model and OpenCV's coefficients; none is plumb_bob with five zeros."""
    if lens is None:
        return "plumb_bob", np.zeros(5)
    coefficients = np.asarray(lens.coefficients, dtype=np.float64)
    if lens.type != "brown_conrady":
        return "equidistant", coefficients
    return ("rational_polynomial", coefficients) if coefficients[5:].any() else ("plumb_bob", coefficients[:5])


def _transform(pose: NDArray[np.float64]) -> Any:
    w, x, y, z = quaternion(pose[:3, :3]).tolist()
    return make(
        "geometry_msgs/msg/Transform",
        make("geometry_msgs/msg/Vector3", *pose[:3, 3].tolist()),
        make("geometry_msgs/msg/Quaternion", x, y, z, w),
    )
