"""The readings in a ROS bag, ours or any other, read without ROS.

Of its topics PointCloud2, LaserScan and depth images (32FC1, 16UC1) that have a camera_info beside them are shown, each
where /tf has its frame when the message comes; a frame that /tf does not know is taken for the world.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcast.ros.messages import DATATYPES, typestore
from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.rotations import rotation_matrix
from rigcast.sensors.specs.lens import BrownConrady, KannalaBrandt, Lens
from rigcast.view.shots import VALUES, Share, Shot, arrays_of_image

_FILES = (".mcap", ".db3")
_ENDINGS = ("/points", "/scan", "/depth/image")  # of our topics, after the sensor's name
_ENCODINGS = {"32FC1": ("f4", 1.0), "16UC1": ("u2", 1e-3)}  # of depth images: type, metres in a step
_HALF_A_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # ROS counts from the centre of the first one
_BROWN_CONRADY = (BrownConrady, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"))
_LENSES: Mapping[str, tuple[type[Lens] | None, tuple[str, ...]]] = {
    "plumb_bob": _BROWN_CONRADY,
    "rational_polynomial": _BROWN_CONRADY,
    "equidistant": (KannalaBrandt, ("k1", "k2", "k3", "k4")),
}

Arrays = Mapping[str, Any]


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a folder with metadata.yaml, or a file with a bag's suffix."""
    return (path / "metadata.yaml").is_file() or (path.suffix in _FILES and path.is_file())


def read_bag(path: Path, most: int | None = None) -> Iterator[Shot]:
    """The readings in a bag, MCAP or SQLite, in the order of their messages; those without a point too.

    most: no more than that, the same share of every topic's. One is read at a time.

    Raises InputError where rosbags is not installed, or the bag cannot be read or has nothing to show.
    """
    load_extra("Looking at a bag", "rosbags", "ros")
    with _opened(path) as reader:
        bag = _Bag(reader)
        share = Share([connection.msgcount for connection in bag.shown], most)
        for connection, message in bag.messages([*bag.shown, *bag.of("tf2_msgs/msg/TFMessage")]):
            if connection.topic.endswith(("/tf", "/tf_static")):
                bag.tree.learn(message)
                continue
            arrays = bag.arrays(connection, message) if share.takes(connection.topic) else None
            if arrays is not None:
                pose = bag.tree.pose(message.header.frame_id)
                yield Shot.of(_sensor(connection.topic), _seconds(message.header.stamp), pose, arrays)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from rosbags.highlevel import AnyReader, AnyReaderError

    try:
        with AnyReader([path], default_typestore=typestore()) as reader:
            yield reader
    except (AnyReaderError, OSError) as error:
        raise InputError(f"{path}: cannot be read as a bag: {error}") from None


class _Bag:
    """A bag with what must be known before its readings: fixed transforms and the optics of cameras.

    shown: the connections that readings come by.
    Raises InputError where there is none.
    """

    def __init__(self, reader: Any) -> None:
        self._reader = reader
        self.tree = _Tree()
        for _, message in self.messages([c for c in self.of("tf2_msgs/msg/TFMessage") if c.topic == "/tf_static"]):
            self.tree.learn(message)
        self._cameras: dict[str, Any] = {}
        for connection in self.of("sensor_msgs/msg/CameraInfo"):
            for _, message in islice(self.messages([connection]), 1):
                self._cameras[_namespace(connection.topic)] = message
        self.shown = [
            *self.of("sensor_msgs/msg/PointCloud2"),
            *self.of("sensor_msgs/msg/LaserScan"),
            *(c for c in self.of("sensor_msgs/msg/Image") if _namespace(c.topic) in self._cameras),
        ]
        if not self.shown:
            kinds = sorted({connection.msgtype for connection in reader.connections})
            wanted = "PointCloud2, LaserScan or Image beside a CameraInfo"
            raise InputError(f"{reader.paths[0]}: got {', '.join(kinds) or 'no topic'}, expected {wanted}")

    def of(self, kind: str) -> list[Any]:
        """The connections of a kind of message."""
        return [connection for connection in self._reader.connections if connection.msgtype == kind]

    def messages(self, connections: list[Any]) -> Iterator[tuple[Any, Any]]:
        """Each message of these connections; none of no connection, which to rosbags means all."""
        for connection, _, data in self._reader.messages(connections) if connections else ():
            yield connection, self._reader.deserialize(data, connection.msgtype)

    def arrays(self, connection: Any, message: Any) -> Arrays | None:
        """The arrays of a message; None for an image without depths."""
        if connection.msgtype == "sensor_msgs/msg/Image":
            return _of_image(message, self._cameras[_namespace(connection.topic)])
        return _of_cloud(message) if connection.msgtype == "sensor_msgs/msg/PointCloud2" else _of_scan(message)


class _Tree:
    """The poses of frames by the transforms received so far."""

    def __init__(self) -> None:
        self._links: dict[str, tuple[str, NDArray[np.float64]]] = {}

    def learn(self, message: Any) -> None:
        """Take over the transforms of a TFMessage."""
        for transform in message.transforms:
            self._links[transform.child_frame_id] = (transform.header.frame_id, _matrix(transform.transform))

    def pose(self, frame: str) -> NDArray[np.float64]:
        """The pose (4, 4) of a frame in its root frame."""
        pose, passed = np.eye(4), {frame}
        while frame in self._links:
            frame, link = self._links[frame]
            pose = link @ pose
            if frame in passed:
                raise InputError(f"/tf: frame {frame!r} is above itself, expected a tree")
            passed.add(frame)
        return pose


def _of_cloud(message: Any) -> Arrays:
    order = ">" if message.is_bigendian else "<"
    kinds = {number: kind for kind, number in DATATYPES.items()}
    dtype = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [order + kinds[field.datatype] for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    rows = message.data.reshape(message.height, message.row_step)[:, : message.width * message.point_step]
    cloud = np.frombuffer(rows.tobytes(), dtype)
    points = np.stack([cloud[axis].astype(np.float32) for axis in "xyz"], axis=-1)
    names = {**{name: name for name in VALUES}, "line": "ring"}  # Livox' word
    fields = {names[name]: cloud[name] for name in dtype.names or () if name in names}
    return {**fields, "points": points, "range": np.linalg.norm(points, axis=-1)}


def _of_scan(message: Any) -> Arrays:
    angles = message.angle_min + message.angle_increment * np.arange(len(message.ranges))
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=-1)
    with np.errstate(invalid="ignore"):  # infinite ranges times 0
        points = (around * message.ranges[:, None]).astype(np.float32)
    intensity = {"intensity": message.intensities} if len(message.intensities) else {}
    return {"points": points, "range": message.ranges, **intensity}


def _of_image(message: Any, info: Any) -> Arrays | None:
    if message.encoding not in _ENCODINGS:
        return None
    kind, metres = _ENCODINGS[message.encoding]
    pixels = np.dtype((">" if message.is_bigendian else "<") + kind)
    rows = message.data.reshape(message.height, message.step)[:, : message.width * pixels.itemsize]
    depth = np.frombuffer(rows.tobytes(), pixels).reshape(message.height, message.width).astype(np.float32) * metres
    depth[depth == 0] = np.nan  # REP-118: no reading
    return arrays_of_image(depth.astype(np.float32), info.k.reshape(3, 3) + _HALF_A_PIXEL, _lens(info))


def _lens(info: Any) -> Lens | None:
    """The lens of a CameraInfo; its coefficients come in OpenCV's order."""
    kind, names = _LENSES.get(info.distortion_model, (None, ()))
    return kind(**dict(zip(names, info.d.tolist(), strict=False))) if kind is not None and info.d.any() else None


def _matrix(transform: Any) -> NDArray[np.float64]:
    q, t = transform.rotation, transform.translation
    pose = np.eye(4)
    pose[:3, :3] = rotation_matrix([q.w, q.x, q.y, q.z])
    pose[:3, 3] = t.x, t.y, t.z
    return pose


def _namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


def _sensor(topic: str) -> str:
    ending = next((ending for ending in _ENDINGS if topic.endswith(ending) and topic != ending), "")
    return topic.removesuffix(ending).strip("/")


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)
