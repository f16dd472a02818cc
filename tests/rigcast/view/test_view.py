"""A view shows what the sensors saw: in a page, in a browser, and in a rerun recording."""

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from PIL import Image
from shell_calls import call

import rigcast
from rigcast.view.in_rerun import show_in_rerun
from rigcast.view.page import MOST_POINTS, MOST_SHOTS, WIDEST, write_page
from rigcast.view.run_folder import read_run
from rigcast.view.shots import Share, Shot, shot_of

MODEL = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 30 1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <geom name="pillar" type="cylinder" pos="2 1.5 1" size="0.3 1"/>
    <geom name="pipe" type="capsule" pos="2 -1.5 1" size="0.2 0.5"/>
    <body name="cart" pos="0 0 0.5"><joint type="slide" axis="1 0 0"/><geom type="box" size="0.2 0.2 0.2"/></body>
  </worldbody>
  <keyframe><key name="rolling" qvel="1"/></keyframe>
</mujoco>
"""
RIG = """\
model: cart.xml
keyframe: rolling
sensors:
  - {name: top, type: lidar, mount: {body: cart, pos: [0, 0, 0.5]}, elevation_deg: [-20, -10, 0, 10], columns: 180,
     rate_hz: 20}
  - {name: front, type: depth_camera, mount: {body: cart, pos: [0.3, 0, 0]}, resolution: [32, 24], fov_y_deg: 60,
     rate_hz: 20}
"""
CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), ""
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view")
    (path / "cart.xml").write_text(MODEL)
    (path / "cart.yaml").write_text(RIG)
    return path


@pytest.fixture(scope="module")
def frames(folder: Path) -> list[rigcast.Frame]:
    rig = rigcast.load_rig(folder / "cart.yaml", device="cpu")
    data = mujoco.MjData(rig.model)
    mujoco.mj_resetDataKeyframe(rig.model, data, 0)
    seen = []
    for _ in range(20):
        mujoco.mj_step(rig.model, data)
        seen += rig.step(data)
    return seen


def data_of(page: Path) -> dict[str, Any]:
    (data,) = re.findall(r"const data = (.*);\n", page.read_text(encoding="utf-8"))
    return dict(json.loads(data.replace("<\\/", "</")))


def points_in(document: dict[str, Any], entry: dict[str, Any]) -> Any:
    steps = np.frombuffer(base64.b64decode(entry["points"]), "<u2").reshape(-1, 3)
    return steps * document["step"] + document["low"]


def test_a_page_has_the_points_of_every_reading(folder: Path, frames: list[rigcast.Frame]) -> None:
    write_page(folder / "all.html", "</script> & co", [shot_of(frame) for frame in frames])
    document = data_of(folder / "all.html")
    assert document["title"] == "</script> & co"
    assert [(e["sensor"], e["time"]) for e in document["shots"]] == [(f.sensor, f.time) for f in frames]
    far = []
    low, high = document["scales"]["range"][::-1]
    for entry, frame in zip(document["shots"], frames, strict=True):
        points, distance = frame.points_world.numpy().reshape(-1, 3), frame.range.numpy().ravel()
        points, distance = points[np.isfinite(distance)], distance[np.isfinite(distance)]
        from_middle = points - np.add(document["low"], document["middle"])
        near = np.abs(from_middle).max(axis=1) < 5 * document["reach"]
        np.testing.assert_allclose(points_in(document, entry), points[near], atol=2e-3)
        shown = np.frombuffer(base64.b64decode(entry["values"]["range"]), np.uint8)
        np.testing.assert_allclose(shown, np.clip(255 * (high - distance[near]) / (high - low), 0, 255), atol=1)
        assert ("image" in entry) == (frame.sensor == "front")
        far += np.linalg.norm(from_middle, axis=1).tolist()
    assert np.percentile(far, 90) == pytest.approx(document["reach"] - 0.1), "nine in ten are within reach"


def test_a_camera_that_sees_behind_itself_is_shown_by_its_ranges(folder: Path) -> None:
    """Its z-depths are negative there, and would get the warmest colour."""
    depth, distance = np.full((4, 6), -3.0, np.float32), np.full((4, 6), 3.0, np.float32)
    depth[0], distance[1] = 1.0, np.inf
    arrays = {"depth": depth, "range": distance, "points": np.ones((4, 6, 3), np.float32), "intrinsics": np.eye(3)}
    shots = [Shot.of("behind", 0.0, np.eye(4), arrays)]
    shots.append(Shot.of("ahead", 0.0, np.eye(4), {**arrays, "depth": np.abs(depth)}))
    assert [(shot.shows, shot.intrinsics is None) for shot in shots] == [("range", True), ("depth", False)]
    np.testing.assert_array_equal(shots[0].image, distance)
    write_page(folder / "behind.html", "behind", shots)
    document = data_of(folder / "behind.html")
    assert document["depth"][0] >= 1.0
    assert [entry["shows"] for entry in document["shots"]] == ["range", "depth"]


def test_of_many_readings_every_sensor_keeps_the_same_share() -> None:
    share = Share([150, 150, 3], MOST_SHOTS)
    assert [share.takes(sensor) for sensor in "abababc"] == [True, True, False, False, True, True, True]


def test_of_many_points_a_share_is_kept() -> None:
    cloud = np.random.default_rng(0).normal(size=(30_000, 3)).astype(np.float32)
    shot = Shot("a", 0.1, np.eye(4), cloud, {"geom_id": np.arange(30_000)}).thinned(MOST_POINTS, WIDEST)
    np.testing.assert_array_equal(shot.points, cloud[::2])
    np.testing.assert_array_equal(shot.values["geom_id"], np.arange(0, 30_000, 2))


def test_of_a_long_run_only_what_a_page_shows_is_kept(
    folder: Path, frames: list[rigcast.Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at, written = list[str](), list[Shot]()

    def look_at(frame: rigcast.Frame) -> Shot:
        looked_at.append(frame.sensor)
        return shot_of(frame)

    def write(path: Path, _title: str, shots: list[Shot]) -> None:
        written.extend(shots)
        path.touch()

    for name, own in {"MOST_SHOTS": 10, "WIDEST": 16, "shot_of": look_at, "write_page": write}.items():
        monkeypatch.setattr(f"rigcast.cli.view.{name}", own)
    page = folder / "long.html"
    code, output = call("view", folder / "cart.yaml", "--duration", "0.4", "--save", page, "--device", "cpu")
    assert code == 0, output
    assert looked_at == ["top", "front"] * 4, "every other one of eight"
    assert [shot.sensor for shot in written] == looked_at
    assert [shot.time for shot in written[:2]] == [frame.time for frame in frames[:2]]
    for shot in written[1::2]:
        assert shot.image is not None
        assert (shot.image.shape, shot.size) == ((12, 16), (32, 24))
        assert shot.image.base is None, "the whole image is in memory"


@pytest.mark.parametrize("cloud", [np.zeros((0, 3), np.float32), np.ones((1, 3), np.float32)])
def test_a_page_of_hardly_a_point_is_one_too(folder: Path, cloud: Any) -> None:
    values = {"range": np.ones(len(cloud), np.float32)}
    write_page(folder / "few.html", "few", [Shot("a", 0.0, np.eye(4), cloud, values)])
    document = data_of(folder / "few.html")
    np.testing.assert_allclose(points_in(document, document["shots"][0]), cloud, atol=1e-6)


def test_a_page_of_nothing_is_refused(folder: Path) -> None:
    with pytest.raises(rigcast.InputError, match="none: no frame to show"):
        write_page(folder / "none.html", "none", [])


@pytest.mark.parametrize(
    "given",
    [
        ["--duration", "4"],
        ["--model", "other.xml"],
        ["--device", "cpu"],
        ["--seed", "4"],
        ["--motion", "m.npy"],
        ["--set", "seed=3"],
    ],
    ids=" ".join,
)
def test_options_of_a_rig_are_refused_where_a_run_is_shown(tmp_path: Path, given: list[str]) -> None:
    code, output = call("view", tmp_path, *given, "--save", tmp_path / "page.html")
    assert (code, output) == (2, f"{given[0]}: expected with a rig only; {tmp_path} is shown as it was recorded\n")


@pytest.mark.parametrize("formats", ["npz", "exr,ply"])
def test_a_run_is_read_back(folder: Path, frames: list[rigcast.Frame], formats: str) -> None:
    out = folder / formats
    code, output = call("run", folder / "cart.yaml", "--duration", "0.2", "--out", out, "--format", formats)
    assert code == 0, output
    shots = list(read_run(out))
    assert [(shot.sensor, round(shot.time, 9)) for shot in shots] == [(f.sensor, round(f.time, 9)) for f in frames]
    for shot, frame in zip(shots, frames, strict=True):
        expected = shot_of(frame)
        np.testing.assert_allclose(shot.points, expected.points, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(shot.points_world, expected.points_world, rtol=1e-5, atol=1e-5)
        np.testing.assert_array_equal(shot.values["geom_id"], expected.values["geom_id"])
        np.testing.assert_allclose(shot.values["range"], expected.values["range"], rtol=1e-5)
        assert (shot.image is None) == (expected.image is None)


def test_a_run_that_was_killed_is_read_back(folder: Path, frames: list[rigcast.Frame], tmp_path: Path) -> None:
    rig = rigcast.load_rig(folder / "cart.yaml", device="cpu")
    with rigcast.Recorder(tmp_path / "run", rig.model, rig.sensors, ["npz"]) as recorder:
        for frame in frames[:3]:
            recorder.write(frame)
        killed = shutil.copytree(tmp_path / "run", tmp_path / "killed")
    with (killed / "frames.jsonl").open("a") as journal:
        journal.write('{"sensor": "top", "fra')
    shots = list(read_run(killed))
    assert [(shot.sensor, shot.time) for shot in shots] == [(frame.sensor, frame.time) for frame in frames[:3]]
    assert call("view", killed, "--save", tmp_path / "page.html")[0] == 0


@pytest.mark.parametrize("formats", ["npz", "ply"])
def test_a_run_that_hit_nothing_is_read_back(folder: Path, formats: str) -> None:
    out = folder / "nothing" / formats
    near = ("--duration", "0.06", "--set", "sensors.*.max_range=0.01")
    code, output = call("run", folder / "cart.yaml", *near, "--out", out, "--format", formats)
    assert code == 0, output
    code, output = call("view", out, "--save", out / "nothing.html")
    assert code == 0, output
    assert [len(points_in(page, shot)) for page in [data_of(out / "nothing.html")] for shot in page["shots"]] == [0, 0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["."], "frames.npz: cannot be read: No such file or directory; expected a folder of rigcast run"),
        (["cart.yaml", "--save", "x.png"], "--save: got 'x.png', expected a name that ends in .html or .rrd"),
        (["cart.yaml", "--duration", "0.02", "--save", "x.html"], "cart.yaml: no frame was complete in 0.02 s"),
        (["gone.yaml", "--save", "x.html"], "gone.yaml: cannot be read: No such file"),
    ],
)
def test_what_cannot_be_shown_is_told(
    folder: Path, arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    code, output = call("view", *arguments)
    assert code == 2
    assert message in output
    assert not (folder / "x.html").exists()


@pytest.mark.parametrize("kept", [0, 100])
@pytest.mark.parametrize("name", ["frames.npz", "top/000000.npz"])
def test_a_file_that_is_cut_off_is_named(folder: Path, tmp_path: Path, name: str, kept: int) -> None:
    out = tmp_path / "out"
    assert call("run", folder / "cart.yaml", "--duration", "0.06", "--out", out, "--format", "npz")[0] == 0
    (out / name).write_bytes((out / name).read_bytes()[:kept])
    code, output = call("view", out, "--save", tmp_path / "x.html")
    assert (code, f"{out / name}: cannot be read: " in output) == (2, True), output


@pytest.mark.parametrize("name", ["dataset.json", "entry.json"])
def test_a_data_set_in_place_of_a_run_is_told_apart(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("{}")
    np.savez(tmp_path / "frames.npz", np.ones(3))
    code, output = call("view", tmp_path, "--save", tmp_path / "x.html")
    assert (code, "a data set, or an episode of one, which rigcast.open_dataset reads; expected" in output) == (2, True)


def test_a_rig_is_shown_as_a_recorded_motion_moves_it(folder: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "motion.npy", [[0.0], [1.0], [1.0]])
    moved: tuple[str | Path, ...] = ("--motion", tmp_path / "motion.npy", "--motion-rate", "20")
    code, output = call("view", folder / "cart.yaml", *moved, "--save", tmp_path / "page.html")
    assert (code, output.splitlines()[-1]) == (0, f"{tmp_path / 'page.html'}: 4 frames"), output
    shots = data_of(tmp_path / "page.html")["shots"]
    assert [shot["origin"][0] for shot in shots if shot["sensor"] == "top"] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(("seed", "speed"), [((), 3.0), (("--seed", "5"), 5.0)])
def test_a_rig_is_shown_as_a_controller_moves_it_by_the_seed_for_as_long_as_asked(
    folder: Path, tmp_path: Path, seed: tuple[str, ...], speed: float
) -> None:
    (folder / "driving.py").write_text(
        "def drive(model, seed):\n    def control(data):\n        data.qvel[:] = seed\n    return control\n"
    )
    every = ("--set", "seed=3", "--set", "sensors.top.rate_hz=null", "--controller", "driving:drive", *seed)
    code, output = call("view", folder / "cart.yaml", "--duration", "0.03", *every, "--save", tmp_path / "page.html")
    assert code == 0, output
    shots = data_of(tmp_path / "page.html")["shots"]
    assert [shot["origin"][0] for shot in shots] == pytest.approx([0.01 * speed, 0.02 * speed, 0.03 * speed])


def test_without_rerun_a_page_is_made(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setattr("rigcast.cli.view.find_spec", lambda _name: None)
    code, output = call("view", "cart.yaml", "--duration", "0.1", "--device", "cpu")
    assert code == 0, output
    assert "out/cart.html: 4 frames" in output
    assert len(data_of(folder / "out" / "cart.html")["shots"]) == 4


def screenshot(page: Path, script: str, picture: Path) -> Any:
    """The picture (H, W, 3) that Chromium shows of a page after a script has run in it; its console must be empty."""
    copy = picture.with_suffix(".html")
    copy.write_text(page.read_text().replace("</body>", f"<script>{script}</script></body>"))
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1000,700"]
    own = [f"--user-data-dir={picture.parent / 'profile'}", f"--screenshot={picture}", "--enable-logging=stderr"]
    done = subprocess.run([CHROMIUM, *flags, *own, copy.as_uri()], capture_output=True, text=True, timeout=120)
    assert picture.is_file(), done.stderr
    assert "CONSOLE" not in done.stderr, done.stderr
    with Image.open(picture) as image:
        return np.asarray(image.convert("RGB")).astype(int)


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium on the path")
def test_a_browser_shows_clouds_that_turn_and_images(frames: list[rigcast.Frame], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    write_page(page, "cart", [shot_of(frame) for frame in frames])
    scripts = {
        "start": "",
        "turned": "view.yaw += 1; draw()",
        "later": "element('time').value = 99; show()",
        "by id": "element('by').value = 'geom_id'; legend(); draw()",
        "hidden": "hidden.add('top'); hidden.add('front'); draw()",
    }
    seen = {name: screenshot(page, code, tmp_path / f"{name}.png") for name, code in scripts.items()}
    cloud = {name: picture[60:600, :640] for name, picture in seen.items()}
    coloured = {name: int((np.ptp(part, axis=-1) > 60).sum()) for name, part in cloud.items()}
    assert coloured["start"] > 1000, coloured
    assert coloured["hidden"] == 0, coloured
    for name in ("turned", "later", "by id"):
        assert (cloud[name] != cloud["start"]).any(axis=-1).sum() > 300, name
    assert (np.ptp(seen["start"][60:300, 680:980], axis=-1) > 60).mean() > 0.3, "the depth image"


SHAPES: dict[str, list[Any]] = {
    "floor Boxes3D:half_sizes": [[20, 30, 0.001]],
    "floor Boxes3D:centers": [[0, 0, -0.001]],
    "wall Boxes3D:half_sizes": [[0.1, 3, 1]],
    "wall InstancePoses3D:translations": [[4, 0, 1]],
    "pillar Cylinders3D:lengths": [2],
    "pillar Cylinders3D:radii": [0.3],
    "pipe Capsules3D:lengths": [1],
    "pipe Capsules3D:radii": [0.2],
    "pipe Capsules3D:translations": [[0, 0, -0.5]],
}


def test_a_rerun_recording_has_clouds_images_and_bodies(folder: Path, frames: list[rigcast.Frame]) -> None:
    chunk = pytest.importorskip("rerun.chunk")
    code, output = call(
        "view", folder / "cart.yaml", "--duration", "0.1", "--save", folder / "c.rrd", "--device", "cpu"
    )
    assert code == 0, output
    read: dict[str, list[Any]] = {}
    for piece in chunk.RrdReader(folder / "c.rrd").stream():
        batch = piece.to_record_batch()
        for name in (name for name in batch.schema.names if ":" in name):
            read.setdefault(f"{piece.entity_path} {name}", []).extend(batch.column(name).to_pylist())
    for name, value in SHAPES.items():
        (got,) = read[f"/bodies/world/{name}"]
        np.testing.assert_allclose(got, value, rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(np.ravel(read["/bodies/cart Transform3D:translation"]), [0.05, 0, 0.5, 0.1, 0, 0.5])
    assert len(read["/sensors/front/camera DepthImage:buffer"]) == 2
    first, second = (frame for frame in frames if frame.sensor == "top" and frame.time < 0.11)
    for k, frame in enumerate((first, second)):
        hit = np.isfinite(frame.range.numpy())
        ids = frame.geom_id.numpy()[hit]
        colours = read["/sensors/top/by_geom_id Points3D:colors"][k]
        assert len(set(zip(ids.tolist(), colours, strict=True))) == len(set(ids.tolist())) == len(set(colours)), k
        by_range = np.array(read["/sensors/top/by_range Points3D:colors"][k])[np.argsort(frame.range.numpy()[hit])]
        red, blue = by_range >> 24, by_range >> 8 & 255
        assert (red[0] > blue[0], red[-1] < blue[-1]) == (True, True), "near is warm"
        for path in ("by_range", "by_ring", "by_geom_id"):
            cloud = read[f"/sensors/top/{path} Points3D:positions"][k]
            np.testing.assert_allclose(cloud, frame.points.numpy()[hit], atol=1e-6, err_msg=path)


def test_in_rerun_a_camera_that_sees_behind_itself_is_a_cloud(tmp_path: Path) -> None:
    """A depth image stands in space by a pinhole, which has no pixels behind it."""
    chunk = pytest.importorskip("rerun.chunk")
    depth, points = np.array([[1.0, -2.0]], np.float32), np.ones((1, 2, 3), np.float32)
    arrays = {"points": points, "range": np.abs(depth), "intrinsics": np.eye(3)}
    shots = [
        Shot.of("behind", 0.0, np.eye(4), {**arrays, "depth": depth}),
        Shot.of("ahead", 0.0, np.eye(4), {**arrays, "depth": np.abs(depth)}),
    ]
    show_in_rerun("cameras", shots, tmp_path / "c.rrd")
    seen = {piece.entity_path for piece in chunk.RrdReader(tmp_path / "c.rrd").stream()}
    assert {"/sensors/behind/by_range", "/sensors/ahead/camera"} <= seen
    assert not {"/sensors/behind/camera", "/sensors/ahead/by_range"} & seen


def test_without_rerun_a_recording_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    code, output = call(
        "view", folder / "cart.yaml", "--duration", "0.1", "--save", folder / "n.rrd", "--device", "cpu"
    )
    assert code == 2
    assert "Looking at sensors in rerun needs rerun, which is not installed; pip install 'rigcast[view]'" in output
    assert "simulated" not in output, "it is refused at once"
    assert not (folder / "n.rrd").exists()
