"""Bags of a real rig on a moving model, read back without rosbags."""

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from ros_bags import Read, cloud, matrix, read_bag, seconds
from ruamel.yaml import YAML

import rigcast
from rigcast.export.ids import IdTable
from rigcast.ros.transforms import TransformTree

XML = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 0.1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <body name="cart" pos="0 0 0.5">
      <freejoint/>
      <geom type="box" size="0.2 0.2 0.2"/>
      <body name="mast" pos="0 0 0.4" euler="0 0 30">
        <geom type="box" size="0.02 0.02 0.2"/>
        <site name="top" pos="0 0 0.2" euler="0 20 0"/>
        <body pos="0.1 0 0">
          <joint name="neck" axis="0 0 1"/><geom size="0.05"/>
          <camera name="head" pos="0.1 0 0" xyaxes="0 -1 0 0 0 1"/>
        </body>
      </body>
    </body>
    <body name="person" mocap="true" pos="2 1 1"><geom type="capsule" size="0.2 0.5"/></body>
    <camera name="watch" mode="targetbody" target="cart" pos="-3 0 2"/>
  </worldbody>
</mujoco>
"""
CART = rigcast.Filter(exclude_bodies=["cart"], exclude_subtree=True)
SENSORS: list[Any] = [
    rigcast.Lidar(
        name="top",
        mount=rigcast.Mount(site="top", pos=(0, 0, 0.1)),
        elevation_deg=[-10, 0],
        columns=24,
        rate_hz=50,
        filter=CART,
    ),
    rigcast.Lidar(
        name="scan", mount=rigcast.Mount(body="mast"), elevation_deg=[0], columns=16, rate_hz=50, filter=CART
    ),
    rigcast.DepthCamera(name="eye", mount=rigcast.Mount(camera="head"), resolution=(8, 6), fov_y_deg=60, rate_hz=25),
    rigcast.DepthCamera(name="cctv", mount=rigcast.Mount(camera="watch"), resolution=(8, 6), fov_y_deg=60, rate_hz=25),
    rigcast.HeightScan(
        name="feet", mount=rigcast.Mount(body="cart"), size=(0.2, 0.2), spacing=0.1, rate_hz=25, filter=CART
    ),
]
STEPS = 24


class Recording:
    """A bag, and the frames and body poses that went into it."""

    def __init__(self, folder: Path, storage: str) -> None:
        model = mujoco.MjModel.from_xml_string(XML)
        data = mujoco.MjData(model)
        data.qvel[:] = [0.5, 0.2, 0.0, 0.3, -0.2, 2.0, 1.5]
        rig = rigcast.Rig(model, SENSORS, device="cpu")
        self.frames: list[Any] = []
        with rigcast.Recorder(folder, model, SENSORS, [storage], classes={"cart": ["cart"]}) as recorder:
            recorder.step(data, ())
            for step in range(STEPS):
                mujoco.mj_step(model, data)
                data.mocap_pos[0] = [2, 1 - 0.01 * step, 1]
                data.mocap_quat[0] = [0.6, 0, 0, 0.8]
                frames = rig.step(data)
                recorder.step(data, frames)
                self.frames += frames
        self.model = model
        self.folder = folder / f"rosbag2_{storage}"
        self.messages = read_bag(self.folder)

    def on(self, topic: str) -> list[Read]:
        return [read for read in self.messages if read.topic == topic]


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return Recording(tmp_path_factory.mktemp("bag"), request.param)


def test_every_frame_is_a_message_at_its_time(recording: Recording) -> None:
    topics = {"top": "/top/points", "scan": "/scan/scan", "eye": "/eye/depth/image", "feet": "/feet/points"}
    for name, topic in topics.items():
        frames = [frame for frame in recording.frames if frame.sensor == name]
        read = recording.on(topic)
        assert len(read) == len(frames) > 1, name
        for frame, message in zip(frames, read, strict=True):
            assert seconds(message.message.header.stamp) == pytest.approx(frame.time, abs=1e-9), name
            assert message.nanoseconds == round(frame.time * 1e9)


def test_clouds_scans_and_images_hold_what_the_frames_hold(recording: Recording) -> None:
    for name, topic in (("top", "/top/points"), ("feet", "/feet/points")):
        frames = [frame for frame in recording.frames if frame.sensor == name]
        for frame, read in zip(frames, recording.on(topic), strict=True):
            points = cloud(read.message).reshape(frame.shape)
            np.testing.assert_array_equal(points["geom_id"], frame.geom_id.numpy())
            np.testing.assert_array_equal(np.stack([points[a] for a in "xyz"], -1), frame.points.numpy())
    frames = [frame for frame in recording.frames if frame.sensor == "scan"]
    for frame, read in zip(frames, recording.on("/scan/scan"), strict=True):
        np.testing.assert_array_equal(np.array(read.message.ranges, np.float32), frame.range.numpy()[0])
    frames = [frame for frame in recording.frames if frame.sensor == "eye"]
    for frame, read in zip(frames, recording.on("/eye/depth/image"), strict=True):
        np.testing.assert_array_equal(np.frombuffer(bytes(read.message.data), "<f4").reshape(6, 8), frame.depth.numpy())
    assert len(recording.on("/eye/depth/camera_info")) == len(frames)


def test_the_transforms_lead_from_the_world_to_every_frame(recording: Recording) -> None:
    """By /tf and /tf_static, the points of a message have the coordinates of `points_world`."""
    (static,) = recording.on("/tf_static")
    fixed = {t.child_frame_id: (t.header.frame_id, matrix(t.transform)) for t in static.message.transforms}
    ids = {"top": "top_frame", "eye": "eye_optical_frame", "cctv": "cctv_optical_frame", "feet": "feet_frame"}
    for frame in recording.frames:
        if frame.sensor not in ids:
            continue
        links = dict(fixed)
        for read in recording.on("/tf"):
            for t in read.message.transforms:
                if seconds(t.header.stamp) == pytest.approx(frame.time, abs=1e-9):
                    links[t.child_frame_id] = (t.header.frame_id, matrix(t.transform))
        pose, child = np.eye(4), ids[frame.sensor]
        while child != "map":
            child, transform = links[child]
            pose = transform @ pose
        np.testing.assert_allclose(pose, frame.pose, atol=1e-9, err_msg=f"{frame.sensor} at {frame.time}")


def test_bodies_that_never_move_are_static_and_the_others_are_not(recording: Recording) -> None:
    (static,) = recording.on("/tf_static")
    fixed = {(t.header.frame_id, t.child_frame_id) for t in static.message.transforms}
    moving = {(t.header.frame_id, t.child_frame_id) for r in recording.on("/tf") for t in r.message.transforms}
    assert fixed == {
        ("cart", "mast"),
        ("mast", "top_frame"),
        ("mast", "scan_frame"),
        ("body_3", "eye_frame"),
        ("eye_frame", "eye_optical_frame"),
    }
    assert moving == {
        ("map", "cart"),
        ("mast", "body_3"),
        ("map", "person"),
        ("map", "cctv_optical_frame"),
        ("map", "feet_frame"),
    }


def test_a_mocap_body_is_turned_as_its_data_say(recording: Recording) -> None:
    turned = [
        t.transform for read in recording.on("/tf") for t in read.message.transforms if t.child_frame_id == "person"
    ]
    expected = [[-0.28, -0.96, 0.0], [0.96, -0.28, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(matrix(turned[-1])[:3, :3], expected, atol=1e-12)


def test_the_clock_goes_forward_at_its_rate_and_at_every_frame(recording: Recording) -> None:
    times = [seconds(read.message.clock) for read in recording.on("/clock")]
    assert times == sorted(set(times))
    assert times[0] == 0.0
    np.testing.assert_allclose(times, np.arange(len(times)) * 0.01, atol=1e-9)  # 100 Hz, frames at multiples of that
    logged = [read.nanoseconds for read in recording.messages]
    assert logged == sorted(logged)


def test_the_id_table_is_in_the_bag(recording: Recording) -> None:
    (read,) = recording.on("/rigcast/ids")
    table = json.loads(read.message.data)
    assert table == IdTable.of(recording.model, {"cart": ["cart"]}).lists()
    assert table["geom_name"][:2] == ["floor", "wall"]
    assert table["geom_class"] == [0, 0, 1, 1, 1, 0]


def test_the_metadata_describe_the_bag(recording: Recording) -> None:
    text = (recording.folder / "metadata.yaml").read_text()
    about = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
    assert about["message_count"] == len(recording.messages)
    assert about["relative_file_paths"] == [path.name for path in recording.folder.iterdir() if path.suffix != ".yaml"]
    for entry in about["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        (qos,) = topic["offered_qos_profiles"]
        latched = topic["name"] in ("/tf_static", "/rigcast/ids")
        assert (qos["durability"], qos["depth"]) == (("transient_local", 1) if latched else ("volatile", 10))


@pytest.mark.parametrize(
    ("sensor", "world", "message"),
    [("hull", "map", "'hull_frame' is the name of a body too"), ("eye", "hull_frame", "'hull_frame' is the name")],
)
def test_a_frame_called_like_a_body_is_refused(sensor: str, world: str, message: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='hull_frame'><geom size='1'/></body></worldbody></mujoco>"
    )
    spec = rigcast.Lidar(name=sensor, mount=rigcast.Mount(), elevation_deg=[0], columns=4)
    with pytest.raises(rigcast.InputError, match=message):
        TransformTree(model, [spec], world)
