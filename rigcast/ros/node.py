"""A ROS 2 node that publishes what a rig senses, live, with rclpy."""

from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from types import TracebackType
from typing import Any

import mujoco

from rigcast.export.ids import Classes, IdTable
from rigcast.export.options import Export
from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.rig.frame import Frame, as_frames
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .stream import MessageStream, Topic


class RosNode:
    """A node that publishes the messages that a bag would hold, on the same topics.

    If rclpy is not running it is started, and stopped by `close`. Subscribers follow the simulation's clock with
    `use_sim_time`. Leaving a `with` block calls `close`.

    Args:
        model: the rig's.
        sensors: those of the rig whose frames will be published.
        classes: names of geoms, bodies, flexes, skins and props by class, as in a rig's `classes:`.
        props: those of the rig.
        options: as in a rig's `export:`.
        name: of the node.

    Raises:
        InputError: rclpy, or rosbags, which serializes messages, is not installed; names of sensors that ROS does not
            allow; classes that do not fit the model.

    >>> with RosNode(model, rig.sensors) as node:
    ...     mujoco.mj_step(model, data)
    ...     node.step(data, rig.step(data))
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        sensors: Sequence[SensorSpec],
        *,
        classes: Classes | None = None,
        props: Sequence[Prop] = (),
        options: Export | None = None,
        name: str = "rigcast",
    ) -> None:
        require_ros()
        options = Export() if options is None else options
        self._names = [spec.name for spec in sensors]
        self._stream = MessageStream(model, sensors, IdTable.of(model, classes, props), options)
        self._rclpy = import_module("rclpy")
        self._owns_context = not self._rclpy.ok()
        if self._owns_context:
            self._rclpy.init()
        self._node = self._rclpy.create_node(name)
        self._publishers = {topic.name: self._publisher(topic) for topic in self._stream.topics}

    def step(self, data: mujoco.MjData, frames: Iterable[Frame]) -> None:
        """Publish clock, transforms and the frames of one step; call it after every step, with or without frames.

        Raises InputError for frames of other sensors or of many worlds.
        """
        for message in self._stream.step(data, as_frames("RosNode.step: frames", frames, self._names)):
            self._publishers[message.topic].publish(message.data)  # rclpy takes bytes as a message serialized already

    def close(self) -> None:
        """Take the node down."""
        self._node.destroy_node()
        if self._owns_context:
            self._rclpy.try_shutdown()

    def __enter__(self) -> "RosNode":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _publisher(self, topic: Topic) -> Any:
        qos = import_module("rclpy.qos")
        durability = qos.DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else qos.DurabilityPolicy.VOLATILE
        profile = qos.QoSProfile(depth=1 if topic.latched else 10, durability=durability)
        package, _, kind = topic.kind.split("/")
        return self._node.create_publisher(getattr(import_module(f"{package}.msg"), kind), topic.name, profile)


def require_ros() -> None:
    """Raise InputError where rclpy or rosbags is not installed."""
    if find_spec("rclpy") is None:
        raise InputError(
            "publishing needs rclpy, which comes with ROS 2 and not from PyPI: source the setup.bash of a ROS 2 "
            "installation and use the Python that it was made for; a bag can be written without ROS: --format mcap"
        )
    load_extra("publishing", "rosbags", "ros")
