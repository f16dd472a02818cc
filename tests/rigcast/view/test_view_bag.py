"""A view of a bag shows what the sensors saw, in every layout; third-party bags are shown, too."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from typer.testing import CliRunner

import rigcast
from rigcast.cli import app
from rigcast.export.options import Export
from rigcast.ros import layouts, messages
from rigcast.view.bag import is_bag, read_bag
from rigcast.view.run_folder import read_run
from rigcast.view.shots import Shot, shot_of

XML = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 0.1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <body name="cart" pos="0 0 0.5">
      <joint type="slide" axis="1 0.5 0"/><joint axis="0 0 1"/><geom type="box" size="0.2 0.2 0.2"/>
      <body name="mast" pos="0 0 0.4" euler="0 0 30"><geom size="0.02"/></body>
    </body>
  </worldbody>
</mujoco>
"""
CART = rigcast.Filter(exclude_bodies=["cart"], exclude_subtree=True)
LENS = rigcast.BrownConrady(k1=-0.3, k2=0.1, p1=0.001, p2=-0.002, k3=-0.01)
CAMERA: dict[str, Any] = {"resolution": (16, 12), "fx": 12, "fy": 12, "cx": 8, "cy": 6, "filter": CART, "rate_hz": 20}
MAST = rigcast.Mount(body="mast", pos=(0.1, 0, 0))
SENSORS: list[Any] = [
    rigcast.Lidar(name="top", mount=MAST, elevation_deg=[-20, -9, 0], columns=24, rate_hz=20, filter=CART),
    rigcast.Lidar(name="scan", mount=MAST, elevation_deg=[0], columns=16, rate_hz=20, filter=CART),
    rigcast.DepthCamera(name="eye", mount=MAST, **CAMERA),
    rigcast.DepthCamera(name="bent", mount=MAST, distortion=LENS, **CAMERA),
    rigcast.DepthCamera(
        name="fish", mount=MAST, distortion=rigcast.KannalaBrandt(k1=-0.02, k2=0.01, k3=0, k4=0), **CAMERA
    ),
]


def record(folder: Path, formats: list[str], **options: Any) -> list[Shot]:
    """Drive the cart, record its frames, and return them as shots."""
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0, 2.0
    rig = rigcast.Rig(model, SENSORS, device="cpu")
    seen = []
    with rigcast.Recorder(folder, model, SENSORS, formats, options=Export(**options)) as recorder:
        recorder.step(data, ())
        for _ in range(20):
            mujoco.mj_step(model, data)
            frames = rig.step(data)
            recorder.step(data, frames)
            seen += [shot_of(frame) for frame in frames]
    return seen


def hold_equal(read: list[Shot], seen: list[Shot], names: tuple[str, ...], tolerance: float = 2e-5) -> None:
    assert [(s.sensor, round(s.time, 6)) for s in read] == [(s.sensor, round(s.time, 6)) for s in seen]
    for got, expected in zip(read, seen, strict=True):
        about = f"{got.sensor} at {got.time}"
        np.testing.assert_allclose(got.pose, expected.pose, atol=1e-9, err_msg=about)
        order = [np.lexsort(np.round(shot.points, 2).T) for shot in (got, expected)]
        a, b = (shot.points_world[k] for shot, k in zip((got, expected), order, strict=True))
        np.testing.assert_allclose(a, b, atol=tolerance, err_msg=about)
        for name in {"range", *names} & set(expected.values):
            a, b = (shot.values[name][k] for shot, k in zip((got, expected), order, strict=True))
            np.testing.assert_allclose(a, b, rtol=1e-5, atol=tolerance, err_msg=f"{name} of {about}")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_holds_what_was_seen(storage: str, tmp_path: Path) -> None:
    seen = record(tmp_path, [storage])
    hold_equal(list(read_bag(tmp_path / f"rosbag2_{storage}")), seen, ())
    (file,) = (path for path in (tmp_path / f"rosbag2_{storage}").iterdir() if path.suffix != ".yaml")
    assert is_bag(file)
    assert len(list(read_bag(file))) == len(seen)
    assert len(list(read_run(tmp_path))) == len(seen), "the folder of a run that has a bag only"


def test_lidars_keep_their_rings_and_ids(tmp_path: Path) -> None:
    seen = [shot for shot in record(tmp_path, ["mcap"]) if shot.sensor == "top"]
    read = [shot for shot in read_bag(tmp_path / "rosbag2_mcap") if shot.sensor == "top"]
    hold_equal(read, seen, ("ring", "geom_id"))
    assert set(read[0].values) == {"range", "intensity", "ring", "geom_id"}


@pytest.mark.parametrize("layout", ["velodyne", "ouster", "livox", "hesai"])
def test_every_layout_is_shown(layout: str, tmp_path: Path) -> None:
    seen = [shot for shot in record(tmp_path, ["mcap"], point_layout=layout) if shot.sensor == "top"]
    read = [shot for shot in read_bag(tmp_path / "rosbag2_mcap") if shot.sensor == "top"]
    hold_equal(read, seen, ("ring",))
    assert {"range", "intensity", "ring"} == set(read[0].values)


def test_depth_in_millimetres_is_shown(tmp_path: Path) -> None:
    seen = [shot for shot in record(tmp_path, ["mcap"], depth_encoding="16UC1") if shot.image is not None]
    read = [shot for shot in read_bag(tmp_path / "rosbag2_mcap") if shot.image is not None]
    assert len(read) == len(seen) > 0
    for got, expected in zip(read, seen, strict=True):
        assert got.image is not None
        assert expected.image is not None
        hit = np.isfinite(expected.image)
        np.testing.assert_array_equal(np.isfinite(got.image), hit)
        np.testing.assert_allclose(got.image[hit], expected.image[hit], atol=5.1e-4)


def test_points_of_cameras_are_where_their_images_have_them(tmp_path: Path) -> None:
    record(tmp_path, ["mcap"], depth_points=True)
    read = list(read_bag(tmp_path / "rosbag2_mcap"))
    images = [shot for shot in read if shot.sensor == "bent"]
    clouds = [shot for shot in read if shot.sensor == "bent/depth"]
    hold_equal([replace(shot, sensor="bent") for shot in clouds], images, ())


def test_images_of_a_run_are_spread_by_their_lens(tmp_path: Path) -> None:
    seen = [shot for shot in record(tmp_path, ["exr", "ply"]) if shot.image is not None]
    hold_equal([shot for shot in read_run(tmp_path) if shot.image is not None], seen, ("geom_id",))


@pytest.mark.parametrize("formats", [["mcap"], ["npz"]])
def test_at_most_so_many_are_read(formats: list[str], tmp_path: Path) -> None:
    seen = record(tmp_path, formats)
    read = list(read_run(tmp_path, most=12))
    assert len(read) == 10
    for name in {shot.sensor for shot in seen}:
        times = [round(shot.time, 6) for shot in seen if shot.sensor == name]
        assert [round(shot.time, 6) for shot in read if shot.sensor == name] == times[::2], name


def write_bag(folder: Path, sent: list[tuple[str, Any]]) -> Path:
    """Write a third-party bag: messages by topic, a second apart."""
    kinds = {topic: message.__msgtype__ for topic, message in sent}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {t: writer.add_connection(t, kind, typestore=messages.typestore()) for t, kind in kinds.items()}
        for k, (topic, message) in enumerate(sent):
            writer.write(connections[topic], 10**9 * k, messages.serialize(message))
    return folder


def cloud(dtype: Any, points: Any, frame: str = "lidar") -> Any:
    array = np.zeros((1, len(points)), dtype)
    for k, axis in enumerate("xyz"):
        array[axis] = np.array(points)[:, k]
    return messages.point_cloud(1.0, frame, layouts.Points(array, True))


def test_a_bag_of_others_is_shown(tmp_path: Path) -> None:
    """Doubles with a gap between them, a topic of another name, no transforms and messages that are not shown."""
    dtype = np.dtype({"names": ["x", "y", "z"], "formats": ["<f8"] * 3, "offsets": [4, 12, 24], "itemsize": 40})
    folder = write_bag(tmp_path / "other", [("/chatter", messages.text("hi")), ("/velo", cloud(dtype, [[1, 2, 3]]))])
    (shot,) = read_bag(folder)
    assert (shot.sensor, shot.time) == ("velo", 1.0)
    np.testing.assert_array_equal(shot.pose, np.eye(4))
    np.testing.assert_array_equal(shot.points, [[1, 2, 3]])
    np.testing.assert_allclose(shot.values["range"], np.sqrt(14))


def test_fixed_transforms_count_whenever_they_come(tmp_path: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    fixed = messages.transforms(0.0, {("map", "lidar"): pose})
    xyz = np.dtype([(axis, "<f4") for axis in "xyz"])
    folder = write_bag(tmp_path / "late", [("/points", cloud(xyz, [[1, 0, 0]])), ("/tf_static", fixed)])
    (shot,) = read_bag(folder)
    assert shot.sensor == "points"
    np.testing.assert_array_equal(shot.points_world, [[2, 2, 3]])


def loop(folder: Path) -> Path:
    xyz = np.dtype([(axis, "<f4") for axis in "xyz"])
    links = messages.transforms(0.0, {("a", "b"): np.eye(4), ("b", "a"): np.eye(4)})
    return write_bag(folder, [("/tf", links), ("/points", cloud(xyz, [[1, 0, 0]], "a"))])


def broken(folder: Path) -> Path:
    folder.mkdir()
    (folder / "metadata.yaml").write_text("nothing: of the kind")
    return folder


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: write_bag(folder, [("/chatter", messages.text("hi"))]), "got std_msgs/msg/String, expected"),
        (loop, "/tf: frame 'a' is above itself, expected a tree"),
        (broken, "cannot be read as a bag"),
    ],
)
def test_a_bag_that_cannot_be_shown_is_told(make: Any, message: str, tmp_path: Path) -> None:
    bag = make(tmp_path / "bag")
    result = CliRunner().invoke(app, ["view", str(bag), "--save", str(tmp_path / "x.html")])
    assert result.exit_code == 2, result.output
    assert message in result.output
    assert not (tmp_path / "x.html").exists()


def test_a_bag_becomes_a_page(tmp_path: Path) -> None:
    seen = record(tmp_path / "run", ["mcap"])
    result = CliRunner().invoke(app, ["view", str(tmp_path / "run/rosbag2_mcap"), "--save", str(tmp_path / "bag.html")])
    assert result.exit_code == 0, result.output
    assert f"bag.html: {len(seen)} frames" in result.output


def test_without_rosbags_a_bag_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "metadata.yaml").write_text("")
    monkeypatch.setitem(__import__("sys").modules, "rosbags", None)
    with pytest.raises(
        rigcast.InputError, match=r"needs rosbags, which is not installed; pip install 'rigcast\[ros\]'"
    ):
        list(read_bag(tmp_path))
