"""A ROS 2 bag, written without ROS: MCAP or SQLite by rosbags, with its metadata.yaml."""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, cast

import mujoco

from rigcast.export.ids import IdTable
from rigcast.export.options import Export
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .messages import nanoseconds, typestore
from .stream import MessageStream, Topic

Storage = Literal["mcap", "sqlite3"]


class BagRecorder:
    """A bag of a rig's messages; those of steps with frames survive a crash of this process.

    A bag that was not closed lacks metadata.yaml, and an MCAP its index: `ros2 bag reindex` and `mcap recover` add
    them.

    Args:
        folder: to be created; the file in it has its name.
        storage: "mcap" or "sqlite3".
        model, sensors, ids, options: as for `MessageStream`.
    """

    def __init__(
        self,
        folder: Path,
        storage: Storage,
        model: mujoco.MjModel,
        sensors: Sequence[SensorSpec],
        ids: IdTable,
        options: Export,
    ) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        self._stream = MessageStream(model, sensors, ids, options)
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()])
        self._writer.open()
        self._storage = cast(Any, self._writer.storage)
        self._is_mcap = storage == "mcap"
        if not self._is_mcap:
            self._storage.conn.execute("PRAGMA synchronous=OFF")  # safe when this process dies; 10 ms less a frame
        self._connections = {topic.name: self._connect(topic) for topic in self._stream.topics}

    def step(self, data: mujoco.MjData | None, frames: Sequence[Frame]) -> None:
        """Append the messages of one step; without data neither clock nor the transforms of bodies."""
        with _os_errors():
            for message in self._stream.step(data, frames):
                self._writer.write(self._connections[message.topic], nanoseconds(message.time), message.data)
            if frames:
                self._settle()

    def close(self) -> None:
        """Write index and metadata. Raises OSError where that fails."""
        with _os_errors():
            self._writer.close()

    def _settle(self) -> None:
        """Flush messages; rosbags alone would buffer up to a megabyte, or the whole bag in one transaction."""
        if self._is_mcap:
            self._storage.close_chunk()
            self._storage.bio.flush()
        else:
            self._storage.conn.commit()

    def _connect(self, topic: Topic) -> Any:
        qos = [_qos(topic.latched)]
        return self._writer.add_connection(topic.name, topic.kind, typestore=typestore(), offered_qos_profiles=qos)


@contextmanager
def _os_errors() -> Iterator[None]:
    """SQLite's errors, such as that of a full disk, as OSError."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise OSError(str(error)) from error


def _qos(latched: bool) -> Any:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(9223372036, 854775807)
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return Qos(
        QosHistory.KEEP_LAST,
        1 if latched else 10,
        QosReliability.RELIABLE,
        durability,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        False,
    )
