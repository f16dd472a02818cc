"""The part of rclpy that a publisher uses, which keeps what is published. Only tests put it on the path."""

from dataclasses import dataclass, field
from typing import Any

log: list[str] = []
nodes: list["Node"] = []
_running = False


@dataclass
class Publisher:
    kind: type
    topic: str
    qos: Any
    published: list[bytes] = field(default_factory=list)

    def publish(self, message: bytes) -> None:
        if not isinstance(message, bytes | self.kind):
            raise TypeError(f"expected {self.kind} or bytes, got {type(message)}")
        self.published.append(message)
        on_publish(self)


@dataclass
class Node:
    name: str
    publishers: dict[str, Publisher] = field(default_factory=dict)

    def create_publisher(self, msg_type: type, topic: str, qos_profile: Any) -> Publisher:
        self.publishers[topic] = Publisher(msg_type, topic, qos_profile)
        return self.publishers[topic]

    def destroy_node(self) -> None:
        log.append("destroy_node")


def on_publish(_publisher: Publisher) -> None:
    """For tests to replace."""


def ok() -> bool:
    return _running


def init() -> None:
    global _running
    _running = True
    log.append("init")


def try_shutdown() -> None:
    global _running
    _running = False
    log.append("shutdown")


def create_node(node_name: str) -> Node:
    nodes.append(Node(node_name))
    return nodes[-1]
