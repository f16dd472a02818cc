"""Bags read back without rosbags: MCAP by mcap-ros2-support, SQLite by sqlite3 with the definitions in the bag."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.reader import NonSeekingReader
from mcap_ros2._dynamic import generate_dynamic
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

_NUMPY = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}


class Read(NamedTuple):
    topic: str
    kind: str
    nanoseconds: int
    message: Any


def read_bag(folder: Path) -> list[Read]:
    """Every message of a bag, in the order in which they were written."""
    (file,) = (path for path in folder.iterdir() if path.suffix in (".mcap", ".db3"))
    return list(read_mcap(file) if file.suffix == ".mcap" else read_sqlite(file))


def read_mcap(file: Path) -> Iterator[Read]:
    with file.open("rb") as stream:
        reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            assert schema is not None
            yield Read(channel.topic, schema.name, message.log_time, decoded)


def read_sqlite(file: Path) -> Iterator[Read]:
    connection = sqlite3.connect(file)
    definitions = "SELECT topic_type, encoded_message_definition FROM message_definitions"
    decoders = {kind: generate_dynamic(kind, text)[kind] for kind, text in connection.execute(definitions)}
    query = (
        "SELECT topics.name, topics.type, timestamp, data FROM messages "
        "JOIN topics ON topics.id = topic_id ORDER BY messages.id"
    )
    for topic, kind, time, data in connection.execute(query):
        yield Read(topic, kind, time, decoders[kind](data))
    connection.close()


def seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def cloud(message: Any) -> NDArray[Any]:
    """The points (height, width) of a PointCloud2, decoded by the fields that it declares."""
    dtype = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [_NUMPY[field.datatype] for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    assert message.row_step == message.point_step * message.width
    return np.frombuffer(bytes(message.data), dtype).reshape(message.height, message.width)


def matrix(transform: Any) -> NDArray[np.float64]:
    """The matrix (4, 4) of a geometry_msgs/Transform."""
    q, t = transform.rotation, transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = t.x, t.y, t.z
    return pose
