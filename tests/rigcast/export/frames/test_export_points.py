"""Point files and depth images, each read with a third-party reader."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import made_frames
import mujoco
import numpy as np
import png
import pytest
import trimesh
from made_frames import INTRINSICS, POSE, make_frame, random_range
from pypcd4 import PointCloud

from rigcast.export.fields import points_of
from rigcast.export.frames.bins import write_kitti, write_kitti_labels, write_nuscenes, write_nuscenes_labels
from rigcast.export.frames.las import write_las
from rigcast.export.frames.pcd import write_pcd
from rigcast.export.frames.ply import write_ply
from rigcast.export.frames.png import write_png
from rigcast.export.ids import IdTable
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame

IDS = IdTable.of(made_frames.model(), {"ground": ["floor"], "thing": ["crate", "ball"]})
SHAPES: dict[type[Frame], tuple[int, ...]] = {Frame: (50,), LidarFrame: (4, 25), CameraFrame: (6, 9)}
START = 1700000000.0


def a_frame(kind: type[Frame], **given: Any) -> Any:
    return make_frame(kind, random_range(SHAPES[kind], 4), time=START, **given)


def rich_frame(kind: type[Frame]) -> Any:
    """A frame with the optional fields, too: intensity, and ids of flexes, skins and props."""
    rng, shape = np.random.default_rng(1), SHAPES[kind]
    ids = {name: np.full(shape, -1, np.int32) for name in ("flex_id", "skin_id", "prop_id")}
    return a_frame(kind, intensity=rng.uniform(0, 1.2, shape).astype(np.float32), **ids)


def double_return_frame(repeated: bool) -> Any:
    """Rays (4, 25) with two returns each; ring, column and stamp per ray, or repeated for each return."""
    indices = [START + np.linspace(0, 0.1, 100).reshape(4, 25), *np.indices((4, 25), np.int32)]
    if repeated:
        indices = [np.repeat(index[..., None], 2, axis=-1) for index in indices]
    given = dict(zip(("stamp", "ring", "column"), indices, strict=True))
    return make_frame(LidarFrame, random_range((4, 25, 2), 6), time=START, **given)


FRAMES: dict[str, Callable[[], Any]] = {
    "other": lambda: a_frame(Frame),
    "lidar": lambda: a_frame(LidarFrame),
    "camera": lambda: a_frame(CameraFrame),
    "rich": lambda: rich_frame(LidarFrame),
    "returns": lambda: double_return_frame(repeated=False),
    "empty": lambda: make_frame(LidarFrame, np.full((2, 3), np.inf, np.float32), time=START),
}
EXTRAS = ("intensity", "ring", "column", "return_number", "geom_id", "body_id", "flex_id", "skin_id", "prop_id")


@pytest.fixture(params=FRAMES)
def frame(request: pytest.FixtureRequest) -> Any:
    return FRAMES[request.param]()


def expect(got: Any, expected: np.ndarray[Any, Any], name: str) -> None:
    np.testing.assert_array_equal(np.asarray(got), expected, err_msg=name)


def test_pcd_comes_back_exactly(tmp_path: Path, frame: Any) -> None:
    write_pcd(tmp_path / "a.pcd", frame)
    read, points = PointCloud.from_path(tmp_path / "a.pcd"), points_of(frame)
    extras = [name for name in EXTRAS if name in points]
    axes = ["x", "y", "z", "normal_x", "normal_y", "normal_z"]
    assert sorted(read.fields) == sorted([*axes, "time", *extras])
    assert read.metadata.data.value == "binary"
    assert (read.metadata.width, read.metadata.height) == (len(points["range"]), 1)
    for k, axis in enumerate("xyz"):
        expect(read.pc_data[axis], points["points"][:, k], axis)
        expect(read.pc_data[f"normal_{axis}"], points["normal"][:, k], f"normal_{axis}")
    for name in extras:
        expect(read.pc_data[name], points[name], name)
    expect(read.pc_data["time"], (points["stamp"] - START).astype(np.float32), "time")


def test_the_viewpoint_of_a_pcd_is_the_sensors_pose(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", a_frame(LidarFrame))
    viewpoint = PointCloud.from_path(tmp_path / "a.pcd").metadata.viewpoint
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.array(viewpoint[3:]))
    np.testing.assert_array_equal(viewpoint[:3], POSE[:3, 3])
    np.testing.assert_allclose(rotation.reshape(3, 3), POSE[:3, :3], atol=1e-14)


@pytest.mark.parametrize("compress", [False, True])
def test_las_and_laz_come_back(tmp_path: Path, frame: Any, compress: bool) -> None:
    write_las(tmp_path / "a", frame, IDS, compress)
    with laspy.open(tmp_path / "a") as reader:
        assert reader.header.are_points_compressed == compress
        assert (str(reader.header.version), reader.header.point_format.id) == ("1.4", 6)
        read = reader.read()
    points = points_of(frame)
    np.testing.assert_allclose(read.xyz, points["points"], rtol=0, atol=0.5001e-6)
    expect(read.gps_time, points["stamp"], "gps_time")
    expect(read.classification, 63 + IDS.geom_class[points["geom_id"]], "classification")
    if "intensity" in points:
        expected = np.minimum(65535 * points["intensity"].astype(float), 65535)
        np.testing.assert_allclose(read.intensity, expected, rtol=0, atol=0.51)
    for k, axis in enumerate("xyz"):
        expect(read[f"normal_{axis}"], points["normal"][:, k], axis)
    extras = set(EXTRAS) - {"intensity", "return_number"} & points.keys()
    for name in extras:
        expect(read[name], points[name], name)
    assert set(read.point_format.extra_dimension_names) == {"normal_x", "normal_y", "normal_z", *extras}


def test_las_numbers_the_returns_of_a_ray_that_are_there(tmp_path: Path) -> None:
    some = [[1, 2], [1, np.inf], [np.inf, 2], [np.inf, -np.inf], [np.nan, 3]]
    single = make_frame(LidarFrame, np.ones((2, 3), np.float32))
    double = make_frame(LidarFrame, np.array([some], np.float32))
    for frame, expected in ((single, [(1, 1)] * 6), (double, [(1, 2), (2, 2), (1, 1), (1, 1), (1, 1)])):
        write_las(tmp_path / "a.las", frame, IDS, compress=False)
        read = laspy.read(tmp_path / "a.las")
        assert list(zip(read.return_number, read.number_of_returns, strict=True)) == expected


@pytest.mark.parametrize("farthest", [1.0, 2000.0, 3e4, 1e7, 2.0**31])
def test_las_takes_the_smallest_step_in_which_points_fit(tmp_path: Path, farthest: float) -> None:
    points = np.array([[[farthest, -farthest, 0.1]]], np.float32)
    frame = make_frame(LidarFrame, np.ones((1, 1), np.float32), points=points)
    write_las(tmp_path / "a.las", frame, IDS, compress=False)
    read = laspy.read(tmp_path / "a.las")
    step = read.header.scales[0]
    assert farthest / 2**31 < step <= max(1e-6, 10 * farthest / 2**31)
    np.testing.assert_allclose(read.xyz, points[0], rtol=0, atol=0.5001 * step)


def test_geoms_of_no_class_are_unclassified_in_las(tmp_path: Path) -> None:
    write_las(tmp_path / "a.las", a_frame(LidarFrame), IdTable.of(made_frames.model()), compress=False)
    assert set(np.asarray(laspy.read(tmp_path / "a.las").classification)) == {1}


def test_kitti_and_its_labels_come_back(tmp_path: Path, frame: Any) -> None:
    write_kitti(tmp_path / "a.bin", frame)
    write_kitti_labels(tmp_path / "a.label", frame, IDS)
    points = points_of(frame)
    read = np.fromfile(tmp_path / "a.bin", "<f4").reshape(-1, 4)
    expect(read[:, :3], points["points"], "points")
    expect(read[:, 3], points.get("intensity", np.zeros(len(read), np.float32)).clip(0, 1), "intensity")
    labels = np.fromfile(tmp_path / "a.label", "<u4")
    expect(labels & 0xFFFF, IDS.geom_class[points["geom_id"]], "class")
    expect(labels >> 16, points["body_id"], "body")


def test_nuscenes_and_its_labels_come_back(tmp_path: Path, frame: Any) -> None:
    write_nuscenes(tmp_path / "a.pcd.bin", frame)
    write_nuscenes_labels(tmp_path / "a_lidarseg.bin", frame, IDS)
    points = points_of(frame)
    read = np.fromfile(tmp_path / "a.pcd.bin", "<f4").reshape(-1, 5)
    nothing = np.zeros(len(read), np.float32)
    expect(read[:, :3], points["points"], "points")
    expect(read[:, 3], 100 * points.get("intensity", nothing), "intensity")
    expect(read[:, 4], points.get("ring", nothing), "ring")
    expect(np.fromfile(tmp_path / "a_lidarseg.bin", "u1"), IDS.geom_class[points["geom_id"]], "class")


def test_what_is_too_bright_for_a_format_has_its_most(tmp_path: Path) -> None:
    frame = make_frame(LidarFrame, np.ones((1, 3), np.float32), intensity=np.full((1, 3), 1e4, np.float32))
    write_kitti(tmp_path / "a.bin", frame)
    write_nuscenes(tmp_path / "a.pcd.bin", frame)
    write_las(tmp_path / "a.las", frame, IDS, compress=False)
    assert np.fromfile(tmp_path / "a.bin", "<f4")[3::4].tolist() == [1] * 3
    assert np.fromfile(tmp_path / "a.pcd.bin", "<f4")[3::5].tolist() == [255] * 3
    assert np.asarray(laspy.read(tmp_path / "a.las").intensity).tolist() == [65535] * 3


def test_ply_takes_the_fields_that_only_some_frames_have(tmp_path: Path) -> None:
    frame = rich_frame(LidarFrame)
    write_ply(tmp_path / "a.ply", frame)
    read = trimesh.load(tmp_path / "a.ply").metadata["_ply_raw"]["vertex"]["data"]
    for name in ("intensity", "flex_id", "skin_id", "prop_id"):
        expect(read[name].ravel(), points_of(frame)[name], name)


@pytest.mark.parametrize("repeated", [False, True])
def test_several_returns_are_points_of_their_own_with_ring_and_number(repeated: bool) -> None:
    frame = double_return_frame(repeated)
    hit = np.isfinite(frame.range.numpy())
    ring, column, number = np.indices(hit.shape)
    points = points_of(frame)
    expect(points["points"], frame.points.numpy()[hit], "points")
    expect(points["ring"], ring[hit], "ring")
    expect(points["column"], column[hit], "column")
    expect(points["return_number"], number[hit], "return_number")


def test_frames_of_several_worlds_are_refused(tmp_path: Path) -> None:
    frame = a_frame(LidarFrame)
    object.__setattr__(frame, "pose", np.stack([POSE] * 3))
    with pytest.raises(InputError, match=r"sensor 'eye': got a frame of 3 worlds, expected one of one world"):
        write_pcd(tmp_path / "a.pcd", frame)


DEPTHS = [
    (1.2344, 1234),
    (1.2346, 1235),
    (0.0, 0),
    (0.0004, 0),
    (65.534, 65534),
    (65.535, 0),
    (1e9, 0),
    (np.inf, 0),
    (-np.inf, 0),
    (np.nan, 0),
]


def test_png_holds_whole_millimetres_and_0_for_a_miss(tmp_path: Path) -> None:
    depth = np.array([[metres for metres, _ in DEPTHS], [1.0] * len(DEPTHS)], np.float32)
    write_png(tmp_path / "a.png", make_frame(CameraFrame, depth, depth=depth, time=START + 0.1))
    width, height, rows, info = png.Reader(bytes=(tmp_path / "a.png").read_bytes()).read()
    assert (width, height, info["bitdepth"], info["greyscale"], info["alpha"]) == (len(DEPTHS), 2, 16, True, False)
    expect(np.vstack(list(rows)), np.array([[whole for _, whole in DEPTHS], [1000] * len(DEPTHS)]), "depth")


def test_the_text_of_a_png_is_exact(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", a_frame(CameraFrame))
    chunks = [data for kind, data in png.Reader(bytes=(tmp_path / "a.png").read_bytes()).chunks() if kind == b"tEXt"]
    text = dict(chunk.decode("latin-1").split("\0", 1) for chunk in chunks)
    assert text["sensor"] == "eye"
    for name, expected in (
        ("depth_scale", [0.001]),
        ("time", [START]),
        ("pose", POSE.ravel()),
        ("intrinsics", INTRINSICS.ravel()),
    ):
        expect([float(number) for number in text[name].split()], np.asarray(expected), name)
