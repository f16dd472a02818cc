"""The messages of a frame, decoded from their bytes by a third-party library."""

from types import SimpleNamespace
from typing import Any, Literal

import made_frames
import mujoco
import numpy as np
import pytest
from made_frames import make_frame, random_range
from mcap_ros2._dynamic import generate_dynamic
from ros_bags import cloud, seconds

from rigcast.export.ids import IdTable
from rigcast.export.options import Export
from rigcast.ros import messages
from rigcast.ros.layouts import choose_layout
from rigcast.ros.stream import MessageStream, planar_angles
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.pattern import Pattern
from rigcast.sensors.specs.sensor_spec import SensorSpec

MODEL = made_frames.model()
LIDAR = Lidar(name="top", mount=Mount(), elevation_deg=(-1.0, 1.0, 2.0), columns=8)
CAMERA = DepthCamera(name="eye", mount=Mount(), resolution=(6, 4), fov_y_deg=58)
SCANNER = Lidar(name="scan", mount=Mount(), elevation_deg=(0.0,), columns=8, rate_hz=20, min_range=0.1, max_range=30.0)
START = 1700000000.25


def decode(kind: str, data: bytes) -> Any:
    text, _ = messages.typestore().generate_msgdef(kind, ros_version=2)
    return generate_dynamic(kind, text)[kind](data)


def sent(spec: SensorSpec, frame: Frame, **options: Any) -> dict[str, Any]:
    """The decoded messages of a frame by topic."""
    stream = MessageStream(MODEL, [spec], IdTable.of(MODEL), Export(**options))
    kinds = {topic.name: topic.kind for topic in stream.topics}
    return {message.topic: decode(kinds[message.topic], message.data) for message in stream.step(None, [frame])}


def lidar_frame(intensity: bool, seed: int = 3) -> Any:
    """A frame fired column by column within 0.1 s, all rays of a column at once."""
    rng, shape = np.random.default_rng(seed), (3, 8)
    stamp = START + np.broadcast_to(np.linspace(0, 0.0875, 8), shape)
    given = {"intensity": rng.uniform(0, 3, shape).astype(np.float32)} if intensity else {}
    return make_frame(LidarFrame, random_range(shape, seed), sensor="top", time=START, stamp=stamp, **given)


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ([0.0, 0.004, 0.008, 0.012, 0.02, 0.022], [0.0, 0.012, 0.022]),
        ([0.01 * k for k in range(30)], [0.01 * k for k in range(30)]),
        ([1.0, 0.995, 0.999, 1.007], [1.0, 0.995, 1.007]),  # it goes back
    ],
)
def test_the_clock_is_told_once_per_period(times: list[float], expected: list[float]) -> None:
    stream = MessageStream(MODEL, [LIDAR], IdTable.of(MODEL), Export(transform_rate_hz=100))
    data = mujoco.MjData(MODEL)
    told = []
    for data.time in times:
        told += [message.time for message in stream.step(data, []) if message.topic == "/clock"]
    assert told == expected


def test_a_frame_is_sent_when_it_arrives_and_stamped_with_its_own_time() -> None:
    stream = MessageStream(MODEL, [LIDAR], IdTable.of(MODEL), Export())
    data = mujoco.MjData(MODEL)
    data.time = START + 0.5
    *_, points = messages_of_step = stream.step(data, [lidar_frame(False)])
    assert {message.time for message in messages_of_step} == {data.time}
    assert seconds(decode("sensor_msgs/msg/PointCloud2", points.data).header.stamp) == START


DENSE = {
    "velodyne": [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("ring", 16, 4), ("time", 18, 7)],
    "livox": [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
        ("intensity", 12, 7),
        ("tag", 16, 2),
        ("line", 17, 2),
        ("timestamp", 18, 8),
    ],
    "hesai": [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("ring", 16, 4), ("timestamp", 18, 8)],
}
OUSTER = [
    ("x", 0, 7),
    ("y", 4, 7),
    ("z", 8, 7),
    ("intensity", 16, 7),
    ("t", 20, 6),
    ("reflectivity", 24, 4),
    ("ring", 26, 4),
    ("ambient", 28, 4),
    ("range", 32, 6),
]


@pytest.mark.parametrize("intensity", [False, True])
@pytest.mark.parametrize("layout", DENSE)
def test_makers_clouds_hold_the_hits_in_the_order_of_firing(layout: str, intensity: bool) -> None:
    frame = lidar_frame(intensity)
    message = sent(LIDAR, frame, point_layout=layout)["/top/points"]
    assert [(f.name, f.offset, f.datatype) for f in message.fields] == DENSE[layout]
    assert (message.height, message.is_dense, message.is_bigendian) == (1, True, False)
    assert (message.header.frame_id, seconds(message.header.stamp)) == ("top_frame", START)
    order = np.isfinite(frame.range.numpy()).T  # column by column
    points, read = frame.points.numpy().transpose(1, 0, 2)[order], cloud(message)[0]
    for k, axis in enumerate("xyz"):
        np.testing.assert_array_equal(read[axis], points[:, k], axis)
    ring, stamp = frame.ring.numpy().T[order], frame.stamp.numpy().T[order]
    np.testing.assert_array_equal(read["line" if layout == "livox" else "ring"], ring)
    white = 150 if layout == "livox" else 100
    expected = np.minimum(white * frame.intensity.numpy().T[order], 255) if intensity else np.zeros(len(read))
    np.testing.assert_array_equal(read["intensity"], expected)
    if layout == "velodyne":
        np.testing.assert_allclose(read["time"], stamp - START, atol=2e-9)
    else:
        unit = 1e9 if layout == "livox" else 1.0
        np.testing.assert_allclose(read["timestamp"], unit * stamp, rtol=0, atol=unit * 3e-7)


def test_an_ouster_cloud_has_every_ray_in_its_place() -> None:
    frame = lidar_frame(True, seed=5)
    assert all(np.isin([np.inf, -np.inf], frame.range.numpy())), "some too far, some too near"
    message = sent(LIDAR, frame, point_layout="ouster")["/top/points"]
    assert [(f.name, f.offset, f.datatype) for f in message.fields] == OUSTER
    assert (message.point_step, message.height, message.width, message.is_dense) == (48, 3, 8, False)
    read, distance = cloud(message), frame.range.numpy()
    np.testing.assert_array_equal(read["x"], frame.points.numpy()[..., 0])
    np.testing.assert_array_equal(np.isnan(read["z"]), ~np.isfinite(distance))
    expected = [[round(1000.0 * float(metres)) if np.isfinite(metres) else 0 for metres in row] for row in distance]
    np.testing.assert_array_equal(read["range"], expected)
    np.testing.assert_allclose(read["t"], 1e9 * (frame.stamp.numpy() - START), atol=1)
    np.testing.assert_array_equal(read["ring"], frame.ring.numpy())
    intensity = np.minimum(100 * frame.intensity.numpy(), 255)
    np.testing.assert_array_equal(read["intensity"], intensity)
    np.testing.assert_array_equal(read["reflectivity"], np.rint(intensity))


@pytest.mark.parametrize(("clockwise", "ahead"), [(False, (-1, 0, 2)), (True, (1, 0, -2))])
def test_the_rows_of_an_ouster_cloud_are_destaggered(clockwise: bool, ahead: tuple[int, ...]) -> None:
    offset = {"azimuth_offset_deg": (-45.0, 3.0, 90.0), "clockwise": clockwise}  # columns are 45 deg apart
    frame = lidar_frame(True)
    read = cloud(sent(LIDAR.model_copy(update=offset), frame, point_layout="ouster")["/top/points"])
    for row, columns in enumerate(ahead):
        np.testing.assert_array_equal(read["x"][row], np.roll(frame.points.numpy()[row, :, 0], columns))
        fired = 1e9 * (frame.stamp.numpy()[row] - START)
        np.testing.assert_allclose(read["t"][row], np.roll(fired, columns), atol=1)
    sector = LIDAR.model_copy(update=offset | {"azimuth_deg": (0.0, 300.0)})
    read = cloud(sent(sector, frame, point_layout="ouster")["/top/points"])
    np.testing.assert_array_equal(read["x"], frame.points.numpy()[..., 0])


@pytest.mark.parametrize("returns", ["strongest", "dual"])
def test_a_column_of_an_os1s_cloud_is_at_one_azimuth(returns: Literal["strongest", "dual"]) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='20'/></worldbody></mujoco>")
    lidar = Lidar(name="top", mount=Mount(), preset="ouster_os1_64", noise=None, detection=None, returns=returns)
    frame = Rig(model, [lidar]).sense(mujoco.MjData(model))["top"]
    read = cloud(sent(lidar, frame)["/top/points"]).reshape(64, 1024, -1)[..., 0]
    column = np.arctan2(-read["y"], read["x"]) / (2 * np.pi) * 1024
    error = (column - np.arange(1024) + 512) % 1024 - 512
    assert np.abs(error).max() < 0.01, "the offsets are those of 9 and 3 columns"


@pytest.mark.parametrize("kind", ["lidar", "height_scan"])
def test_the_full_cloud_has_every_field_of_the_frame(kind: str) -> None:
    scan = HeightScan(name="top", mount=Mount(), size=(0.4, 0.2), spacing=0.1)
    frame = (
        lidar_frame(True) if kind == "lidar" else make_frame(Frame, random_range((15,), 1), sensor="top", time=START)
    )
    message = sent(LIDAR if kind == "lidar" else scan, frame)["/top/points"]
    read = cloud(message).reshape(frame.shape)
    fields = ("ring", "column", "intensity") if kind == "lidar" else ()
    for name in ("range", "geom_id", "body_id", *fields):
        np.testing.assert_array_equal(read[name], getattr(frame, name).numpy(), name)
    for k, axis in enumerate("xyz"):
        np.testing.assert_array_equal(read[axis], frame.points.numpy()[..., k], axis)
        np.testing.assert_array_equal(read[f"normal_{axis}"], frame.normal.numpy()[..., k], axis)
    np.testing.assert_array_equal(read["timestamp"], frame.stamp.numpy())
    others = {"x", "y", "z", "normal_x", "normal_y", "normal_z", "timestamp"}
    assert set(read.dtype.names) == {"range", "geom_id", "body_id", *fields} | others


def test_two_returns_are_told_apart_by_livox_tag() -> None:
    distance = np.array([[[5.0, 7.0]], [[6.0, np.inf]]], np.float32)
    ring, column = np.indices((2, 1), np.int32)
    frame = make_frame(LidarFrame, distance, sensor="top", ring=ring, column=column, stamp=np.full((2, 1), 0.1))
    read = cloud(sent(LIDAR, frame, point_layout="livox")["/top/points"])[0]
    assert read["tag"].tolist() == [0x00, 0x10, 0x00]
    assert read["line"].tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    ("layout", "preset", "expected"),
    [
        ("auto", None, "full"),
        ("auto", "velodyne_vlp16", "velodyne"),
        ("auto", "ouster_os1_64", "ouster"),
        ("auto", "hokuyo_utm30lx", "full"),
        ("livox", "velodyne_vlp16", "livox"),
        ("full", "ouster_os1_64", "full"),
    ],
)
def test_the_layout_follows_the_maker_unless_it_is_given(layout: Any, preset: str | None, expected: str) -> None:
    assert choose_layout(layout, preset) == expected


def test_a_plane_scanner_gives_a_laser_scan() -> None:
    stamp = START + np.arange(8)[None] * 0.005
    distance = random_range((1, 8), 9)
    frame = make_frame(LidarFrame, distance, sensor="scan", time=START, stamp=stamp)
    scan = sent(SCANNER, frame)["/scan/scan"]
    np.testing.assert_array_equal(np.array(scan.ranges, np.float32), distance[0])
    assert list(scan.intensities) == []
    assert (scan.header.frame_id, seconds(scan.header.stamp)) == ("scan_frame", START)
    step = 2 * np.pi / 8
    got = [scan.angle_min, scan.angle_max, scan.angle_increment, scan.time_increment, scan.scan_time]
    np.testing.assert_allclose(got, [0, 7 * step, step, 0.005, 0.05], rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose([scan.range_min, scan.range_max], [0.1, 30], rtol=1e-7)
    at_every_step = SCANNER.model_copy(update={"rate_hz": None})
    assert sent(at_every_step, frame)["/scan/scan"].scan_time == 0


@pytest.mark.parametrize(
    ("given", "planar"),
    [
        ({"elevation_deg": (0.0,)}, True),
        ({"elevation_deg": (0.0,), "azimuth_deg": (-135, 135)}, True),
        ({"elevation_deg": (0.0,), "azimuth_deg": (100, 300)}, True),
        ({"elevation_deg": (0.0,), "azimuth_offset_deg": (30.0,)}, True),
        ({"elevation_deg": (1.0,)}, False),
        ({"elevation_deg": (0.0, 0.0)}, False),
        ({"elevation_deg": (0.0,), "columns": 1}, False),
    ],
)
def test_the_angles_of_a_plane_scanner_are_those_of_its_rays(given: dict[str, Any], planar: bool) -> None:
    pattern = Lidar(name="a", mount=Mount(), **{"columns": 90, **given}).pattern(MODEL)
    angles = planar_angles(pattern)
    assert (angles is not None) == planar
    if angles is not None:
        rays = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
        np.testing.assert_allclose(rays, pattern.directions[0], atol=1e-12)
        assert (np.diff(angles) > 0).all()


def test_rays_in_a_row_are_a_plane_scanner_too() -> None:
    azimuth = np.linspace(0, 1, 5)
    rays = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=-1)
    angles = planar_angles(Pattern(rays))
    assert angles is not None
    np.testing.assert_allclose(angles, azimuth, atol=1e-12)


def test_a_scan_of_two_returns_has_the_first_of_each() -> None:
    distance = random_range((1, 8, 2), 9)
    scan = sent(SCANNER, make_frame(LidarFrame, distance, sensor="scan", stamp=np.zeros((1, 8))))["/scan/scan"]
    np.testing.assert_array_equal(np.array(scan.ranges, np.float32), distance[0, :, 0])


def test_a_depth_image_is_in_metres_with_the_misses_of_rep_117() -> None:
    frame = make_frame(CameraFrame, random_range((4, 6), 0), time=START)
    image = sent(CAMERA, frame)["/eye/depth/image"]
    assert (image.encoding, image.height, image.width, image.step) == ("32FC1", 4, 6, 24)
    assert (image.header.frame_id, seconds(image.header.stamp)) == ("eye_optical_frame", START)
    read = np.frombuffer(bytes(image.data), "<f4").reshape(4, 6)
    np.testing.assert_array_equal(read, frame.depth.numpy())


def test_a_depth_image_can_be_in_millimetres() -> None:
    depth = np.array([[1.2346, np.inf, -np.inf], [np.nan, 70.0, 0.5]], np.float32)
    image = sent(CAMERA, make_frame(CameraFrame, depth, depth=depth), depth_encoding="16UC1")["/eye/depth/image"]
    assert (image.encoding, image.step) == ("16UC1", 6)
    assert np.frombuffer(bytes(image.data), "<u2").tolist() == [1235, 0, 0, 0, 0, 500]


def test_the_points_of_a_camera_are_sent_where_they_are_asked_for() -> None:
    frame = make_frame(CameraFrame, random_range((4, 6), 0), time=START)
    assert "/eye/depth/points" not in sent(CAMERA, frame)
    points = sent(CAMERA, frame, depth_points=True)["/eye/depth/points"]
    assert (points.header.frame_id, seconds(points.header.stamp)) == ("eye_optical_frame", START)
    assert (points.height, points.width, points.point_step, points.row_step) == (4, 6, 12, 72)
    assert (points.is_bigendian, points.is_dense) == (False, False)
    read = cloud(points)
    assert read.dtype.names == ("x", "y", "z")
    np.testing.assert_array_equal(np.stack([read[axis] for axis in "xyz"], axis=-1), frame.points.numpy())


def test_camera_info_counts_from_the_centre_of_the_first_pixel() -> None:
    """K maps the directions of the pixels to whole numbers: column u, row v."""
    pattern = CAMERA.pattern(MODEL)
    frame = make_frame(CameraFrame, random_range((4, 6), 0), time=START)
    object.__setattr__(frame, "intrinsics", pattern.intrinsics)
    info = sent(CAMERA, frame)["/eye/depth/camera_info"]
    assert (info.height, info.width, info.distortion_model, list(info.d)) == (4, 6, "plumb_bob", [0] * 5)
    seen = pattern.directions @ np.array(info.k).reshape(3, 3).T
    v, u = np.indices((4, 6))
    np.testing.assert_allclose(seen[..., 0] / seen[..., 2], u, atol=1e-12)
    np.testing.assert_allclose(seen[..., 1] / seen[..., 2], v, atol=1e-12)
    np.testing.assert_array_equal(np.array(info.p).reshape(3, 4)[:, :3], np.array(info.k).reshape(3, 3))
    np.testing.assert_array_equal(info.r, np.eye(3).ravel())


LENSES = [
    ("brown_conrady", [1, 2, 3, 4, 5, 0, 0, 0], "plumb_bob", [1, 2, 3, 4, 5]),
    ("brown_conrady", [1, 2, 3, 4, 5, 6, 7, 8], "rational_polynomial", [1, 2, 3, 4, 5, 6, 7, 8]),
    ("kannala_brandt", [1, 2, 3, 4], "equidistant", [1, 2, 3, 4]),
]


@pytest.mark.parametrize(("kind", "coefficients", "model", "d"), LENSES)
def test_camera_info_has_the_lens_by_the_names_of_ros(
    kind: str, coefficients: list[float], model: str, d: list[float]
) -> None:
    frame = make_frame(CameraFrame, random_range((4, 6), 0))
    object.__setattr__(frame, "lens", SimpleNamespace(type=kind, coefficients=np.array(coefficients)))
    info = sent(CAMERA, frame)["/eye/depth/camera_info"]
    assert (info.distortion_model, list(info.d)) == (model, d)


@pytest.mark.parametrize(
    ("time", "stamp"),
    [
        (0.0, (0, 0)),
        (0.1, (0, 100_000_000)),
        (1.9999999999, (2, 0)),
        (7.3, (7, 300_000_000)),
        (1700000000.25, (1700000000, 250_000_000)),
    ],
)
def test_a_stamp_is_the_time_in_whole_nanoseconds(time: float, stamp: tuple[int, int]) -> None:
    made = messages.stamp(time)
    assert (made.sec, made.nanosec) == stamp


@pytest.mark.parametrize("name", ["top-left", "2nd"])
def test_a_name_that_ros_does_not_take_is_refused(name: str) -> None:
    spec = Lidar(name=name, mount=Mount(), elevation_deg=(0.0,), columns=8)
    with pytest.raises(InputError, match=f"ROS topics: sensor '{name}': expected letters, digits and _ only"):
        MessageStream(MODEL, [spec], IdTable.of(MODEL), Export())
