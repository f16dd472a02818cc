"""The messages of a rig, in the order in which a robot's drivers would send them.

    /tf_static /rigcast/ids        once, kept for later subscribers
    /clock /tf                     as the simulation goes
    /<sensor>/points               PointCloud2 of lidars and height scans
    /<sensor>/scan                 LaserScan of scanners in one plane
    /<sensor>/depth/image          Image of depth cameras, beside /<sensor>/depth/camera_info
    /<sensor>/depth/points         PointCloud2 of depth cameras, with `depth_points`

/rigcast/ids is a String: the JSON of `IdTable`, which says what the ids in the points stand for.
"""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.export.ids import IdTable
from rigcast.export.options import Export
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.pattern import Pattern
from rigcast.sensors.specs.sensor_spec import SensorSpec

from . import messages
from .layouts import choose_layout, lay_out, lay_out_pixels
from .transforms import TransformTree


class Topic(NamedTuple):
    """A topic; `latched` ones keep their last message for later subscribers (transient local)."""

    name: str
    kind: str
    latched: bool = False


class Message(NamedTuple):
    """A serialized message. time: when it is sent [s], on the simulation's clock."""

    topic: str
    time: float
    data: bytes


_COMMON = (
    Topic("/tf_static", "tf2_msgs/msg/TFMessage", latched=True),
    Topic("/rigcast/ids", "std_msgs/msg/String", latched=True),
    Topic("/clock", "rosgraph_msgs/msg/Clock"),
    Topic("/tf", "tf2_msgs/msg/TFMessage"),
)


class MessageStream:
    """Turns steps of a simulation into messages.

    topics: all that messages may have.
    Raises InputError for a sensor whose name ROS does not allow, or whose frame has the name of a body.
    """

    def __init__(self, model: mujoco.MjModel, sensors: Sequence[SensorSpec], ids: IdTable, options: Export) -> None:
        _refuse_names(sensors)
        self._ids = ids
        self._options = options
        self._specs = {spec.name: spec for spec in sensors}
        self._tree = TransformTree(model, sensors, options.world_frame)
        self._angles = {spec.name: planar_angles(spec.pattern(model)) for spec in sensors}
        self._last_clock = -math.inf
        self._opened = False
        self.topics = [*_COMMON, *(topic for spec in sensors for topic in self._topics(spec))]

    def step(self, data: mujoco.MjData | None, frames: Sequence[Frame]) -> list[Message]:
        """Messages after a step of the simulation, with its frames.

        Clock and transforms come with every frame, and otherwise at `transform_rate_hz`. Transforms are those of
        `data.time`; `data` may stand as `mj_step` leaves it, and is only read. Without it there are neither, and
        frames are sent at their own times.
        """
        sent = self._moved(data) if data is not None and (frames or self._is_due(data.time)) else []
        for frame in frames:
            sent += self._of_frame(frame, frame.time if data is None else data.time)
        if sent and not self._opened:
            self._opened = True
            return self._opening(sent[0].time) + sent
        return sent

    def _opening(self, time: float) -> list[Message]:
        """Messages that are sent once, before all others."""
        return [
            _message("/tf_static", time, messages.transforms(time, self._tree.static)),
            _message("/rigcast/ids", time, messages.text(self._ids.json())),
        ]

    def _of_frame(self, frame: Frame, time: float) -> Iterator[Message]:
        """The messages of one frame, which are sent at `time` [s]."""
        pose = self._tree.of_frame(frame)
        if pose:
            yield _message("/tf", time, messages.transforms(frame.time, pose))
        spec, frame_id = self._specs[frame.sensor], self._tree.frame_ids[frame.sensor]
        if isinstance(frame, CameraFrame):
            image = messages.depth_image(frame, frame_id, self._options.depth_encoding)
            yield _message(f"/{frame.sensor}/depth/image", time, image)
            info = messages.camera_info(frame, frame_id)
            yield _message(f"/{frame.sensor}/depth/camera_info", time, info)
            if self._options.depth_points:
                points = messages.point_cloud(frame.time, frame_id, lay_out_pixels(frame))
                yield _message(f"/{frame.sensor}/depth/points", time, points)
            return
        angles = self._angles[frame.sensor]
        if angles is not None:
            yield _message(f"/{frame.sensor}/scan", time, messages.laser_scan(frame, frame_id, angles, spec))
            return
        layout = choose_layout(self._options.point_layout, spec.preset)
        points = messages.point_cloud(frame.time, frame_id, lay_out(frame, layout, spec))
        yield _message(f"/{frame.sensor}/points", time, points)

    def _moved(self, data: mujoco.MjData) -> list[Message]:
        self._last_clock = data.time
        clock = _message("/clock", data.time, messages.clock(data.time))
        poses = self._tree.moving(data)
        return [clock, _message("/tf", data.time, messages.transforms(data.time, poses))] if poses else [clock]

    def _is_due(self, time: float) -> bool:
        """Whether a period has passed since the last clock, up to rounding, or the simulation has gone back."""
        passed = (time - self._last_clock) * self._options.transform_rate_hz
        return passed < 0 or passed > 1 - 1e-6

    def _topics(self, spec: SensorSpec) -> list[Topic]:
        if isinstance(spec, DepthCamera):
            points = Topic(f"/{spec.name}/depth/points", "sensor_msgs/msg/PointCloud2")
            return [
                Topic(f"/{spec.name}/depth/image", "sensor_msgs/msg/Image"),
                Topic(f"/{spec.name}/depth/camera_info", "sensor_msgs/msg/CameraInfo"),
                *([points] if self._options.depth_points else []),
            ]
        if self._angles[spec.name] is not None:
            return [Topic(f"/{spec.name}/scan", "sensor_msgs/msg/LaserScan")]
        return [Topic(f"/{spec.name}/points", "sensor_msgs/msg/PointCloud2")]


def planar_angles(pattern: Pattern) -> NDArray[np.float64] | None:
    """(rays,) the angles [rad] of a scanner that fires in its x-y plane at even steps, either way round; else None."""
    directions = pattern.directions.reshape(-1, 3)
    one_row = pattern.directions.ndim == 2 or pattern.directions.shape[0] == 1
    changes = pattern.later is not None
    if changes or pattern.origins is not None or not one_row or np.abs(directions[:, 2]).max() > 1e-9:
        return None
    angles = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0]))
    steps = np.diff(angles)
    even = len(steps) > 0 and steps[0] != 0 and np.abs(steps - steps[0]).max() < 1e-9
    return angles if even else None


def _message(topic: str, time: float, message: Any) -> Message:
    return Message(topic, time, messages.serialize(message))


def _refuse_names(sensors: Sequence[SensorSpec]) -> None:
    wrong = [spec.name for spec in sensors if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", spec.name)]
    if wrong:
        raise InputError(
            f"ROS topics: sensor {', '.join(map(repr, wrong))}: expected letters, digits and _ only, no digit first"
        )
