"""`rigcast run` from the shell: its files, its output, and what it refuses."""

import io
import itertools
from pathlib import Path

import mujoco
import numpy as np
import OpenEXR
import pytest
import trimesh
from PIL import Image
from rich.console import Console
from rich.filesize import decimal
from shell_calls import call

from rigcast.cli.common.moving import Moving
from rigcast.cli.common.progress import progress
from rigcast.motion.simulation import initial_data, step_count
from rigcast.sensors.errors import InputError

MODEL = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 0.1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <body name="cart" pos="0 0 0.5">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom type="box" size="0.2 0.2 0.2"/>
    </body>
  </worldbody>
  <keyframe><key name="rolling" time="7" qpos="1" qvel="0.5"/></keyframe>
</mujoco>
"""

RIG = """\
model: cart.xml
keyframe: rolling
sensors:
  - name: top
    type: lidar
    mount: {body: cart, pos: [0, 0, 0.5]}
    elevation_deg: [-20, 0]
    columns: 36
    rate_hz: 50
  - name: front
    type: depth_camera
    mount: {body: cart, pos: [0.3, 0, 0]}
    resolution: [8, 6]
    fov_y_deg: 60
    rate_hz: 25
  - name: feet
    type: height_scan
    mount: {body: cart, pos: [0.5, 0, 0]}
    size: [0.2, 0.2]
    spacing: 0.1
    rate_hz: 25
"""

# A spring that pushes away from its rest: the angle grows without bound.
DIVERGING = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="torso">
      <joint name="knee" type="hinge" axis="0 1 0" stiffness="-1e7"/>
      <geom size="0.1" pos="0.2 0 0" mass="1"/>
    </body>
    <geom type="box" pos="3 0 0" size="0.1 2 2"/>
  </worldbody>
</mujoco>
"""
DIVERGING_RIG = """\
model: wild.xml
sensors: [{name: top, type: lidar, mount: {}, elevation_deg: [0], columns: 4}]
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with both rigs, made the current one, as the default output is relative."""
    files = {"cart.xml": MODEL, "cart.yaml": RIG, "wild.xml": DIVERGING, "wild.yaml": DIVERGING_RIG}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str) -> tuple[int, str]:
    return call("run", *arguments, "--device", "cpu")


def written(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_run_writes_each_frame_that_fell_due(folder: Path) -> None:
    code, output = run("cart.yaml", "--duration", "0.08")
    assert code == 0, output
    assert sorted(written(folder / "out" / "cart")) == [
        "feet/000000.ply",
        "feet/000001.ply",
        "feet/preview.png",
        "frames.npz",
        "front/000000.exr",
        "front/000001.exr",
        "front/preview.png",
        "ids.json",
        "top/000000.ply",
        "top/000001.ply",
        "top/000002.ply",
        "top/000003.ply",
        "top/preview.png",
    ]
    with np.load(folder / "out" / "cart" / "frames.npz") as index:
        for name, times in (("top", [7.02, 7.04, 7.06, 7.08]), ("front", [7.04, 7.08]), ("feet", [7.04, 7.08])):
            mine = index["sensor"] == name
            assert index["frame"][mine].tolist() == list(range(len(times)))
            np.testing.assert_allclose(index["time"][mine], times, atol=1e-12)


def test_what_is_written_is_what_stands_in_the_model(folder: Path) -> None:
    """The cart rolls at 0.5 m/s from x = 1 towards a wall whose near side is at x = 3.9."""
    run("cart.yaml", "--duration", "0.08", "--out", "o")
    with np.load(folder / "o" / "frames.npz") as index:
        names = index["geom_name"]
        moved = 1 + 0.5 * (index["time"] - 7)
        offset = np.select([index["sensor"] == name for name in ("top", "front", "feet")], [0.0, 0.3, 0.5])
        np.testing.assert_allclose(index["pose"][:, 0, 3], moved + offset, atol=1e-6)
    last = OpenEXR.File(str(folder / "o/front/000001.exr"), separate_channels=True)
    np.testing.assert_allclose(last.channels()["Z"].pixels[2], 3.9 - 1.34, atol=1e-5)
    assert set(names[last.channels()["geom_id"].pixels[2]]) == {"wall"}
    points = trimesh.load(folder / "o/top/000003.ply").metadata["_ply_raw"]["vertex"]["data"]
    ahead = points[(points["column"] == 0) & (points["ring"] == 1)]
    np.testing.assert_allclose([ahead["x"][0], ahead["nx"][0]], [3.9 - 1.04, -1.0], atol=1e-5)
    heights = trimesh.load(folder / "o/feet/000001.ply").vertices
    np.testing.assert_allclose(heights[:, 2], -0.5, atol=1e-5)
    for name in ("top", "front", "feet"):
        with Image.open(folder / "o" / name / "preview.png") as picture:
            assert picture.width == 1200


def test_without_a_terminal_it_prints_few_lines_and_ends_with_what_it_wrote() -> None:
    _, output = run("cart.yaml", "--duration", "0.08", "--out", "o")
    assert "\x1b" not in output
    assert "simulated 0.04 of 0.08 s, 4 frames" in output
    assert output.count("simulated") == 4
    rows = {line.split()[1]: line.split() for line in output.splitlines() if line.startswith("│")}
    assert rows["top"][3:8:2] == ["lidar", "4", "5"]
    assert rows["front"][3:8:2] == ["depth_camera", "2", "3"]
    assert "o/frames.npz: index of 8 frames" in output
    assert output.rstrip().endswith("s in all")


def test_seconds_are_told_by_what_took_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that is a second later at each look."""
    clock = itertools.count(0.0)
    for module in ("rigcast.cli.run", "rigcast.motion.simulation"):
        monkeypatch.setattr(f"{module}.perf_counter", clock.__next__)
    _, output = run("cart.yaml", "--duration", "0.02", "--out", "o")
    assert output.endswith("loading 1.0 s, physics 4.0 s, casting 4.0 s, writing 5.0 s, 28.0 s in all\n")


def test_the_size_of_a_whole_run_is_that_of_its_files(folder: Path) -> None:
    _, output = run("cart.yaml", "--duration", "0.02", "--out", "o", "--format", "zarr")
    size = sum(map(len, written(folder / "o" / "frames.zarr").values()))
    assert f"o/frames.zarr: the whole run, {decimal(size)}\n" in output


def test_a_sensor_that_was_never_due_is_said_to_have_no_frame(folder: Path) -> None:
    code, output = run("cart.yaml", "--duration", "0.03", "--out", "o")
    assert code == 0
    assert sorted(written(folder / "o")) == ["frames.npz", "ids.json", "top/000000.ply", "top/preview.png"]
    assert output.count("(no frame: the first is complete after 0.04 s)") == 2


def test_a_sweep_that_the_run_was_too_short_for_is_said_to_have_no_frame() -> None:
    swept = ["--set", "sensors.top.motion=true", "--set", "sensors.top.latency=0.1"]
    _, output = run("cart.yaml", "--duration", "0.03", "--out", "o", *swept)
    assert "(no frame: the first is complete after 0.1394 s)" in output  # 35 of 36 columns of the second 0.02 s


def test_all_formats_can_be_asked_for(folder: Path) -> None:
    code, _ = run("cart.yaml", "--duration", "0.04", "--out", "o", "--format", "npz, EXR,ply")
    assert code == 0
    assert {"front/000000.npz", "front/000000.exr", "front/000000.ply"} <= written(folder / "o").keys()
    assert {"top/000001.npz", "top/000001.ply"} <= written(folder / "o").keys()
    assert "top/000001.exr" not in written(folder / "o")


def test_the_same_run_gives_the_same_files_bit_for_bit(folder: Path) -> None:
    for out in ("one", "two"):
        run("cart.yaml", "--duration", "0.04", "--out", out, "--seed", "5")
    one, two = written(folder / "one"), written(folder / "two")
    assert one.keys() == two.keys()
    assert [name for name in one if one[name] != two[name]] == []


def test_another_model_can_take_the_place_of_the_rigs_own(folder: Path) -> None:
    (folder / "near.xml").write_text(MODEL.replace('pos="4 0 1"', 'pos="3 0 1"'))
    code, output = run("cart.yaml", "--model", "near.xml", "--duration", "0.04", "--out", "o")
    assert code == 0, output
    depth = OpenEXR.File("o/front/000000.exr", separate_channels=True).channels()["Z"].pixels
    np.testing.assert_allclose(depth[2], 2.9 - 1.32, atol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--duration", "0"], "--duration: got 0.0, expected a positive number of seconds"),
        (["--duration", "-1"], "--duration: got -1.0"),
        (["--duration", "nan"], "--duration: got nan"),
        (["--duration", "inf"], "--duration: got inf"),
        (["--format", "exd"], "no format 'exd', expected any of exr, exr_multipart, png"),
        (["--format", "exr"], "sensor 'top' is a lidar, but format exr is for depth cameras only"),
        (["--format", ","], "got no format, expected any of exr"),
        (["--out", "cart.xml"], "cart.xml: the output folder cannot be written: File exists"),
        (["--out", "cart.xml/below"], "cart.xml/below: the output folder cannot be written: Not a directory"),
        (["--model", "gone.xml"], "gone.xml"),
    ],
)
def test_what_cannot_be_done_is_one_message_and_leaves_nothing(
    folder: Path, arguments: list[str], message: str
) -> None:
    before = written(folder)
    code, output = run("cart.yaml", *arguments)
    assert code == 2
    assert message in output
    assert "simulated" not in output
    assert written(folder) == before


def test_a_refused_run_leaves_an_earlier_one_alone(folder: Path) -> None:
    run("cart.yaml", "--duration", "0.04", "--out", "o")
    before = written(folder / "o")
    assert run("cart.yaml", "--out", "o", "--format", "exr")[0] == 2
    assert written(folder / "o") == before


def test_a_simulation_that_diverges_is_reported_and_earlier_frames_are_kept(folder: Path) -> None:
    code, output = run("wild.yaml", "--out", "o")
    assert code == 2
    assert "the simulation diverged at t = " in output
    assert "of joint 'knee'" in output
    with np.load(folder / "o" / "frames.npz") as index:
        kept = len(index["sensor"])
        assert f"{kept} frames from before are in o" in output
        assert [(folder / "o" / file).is_file() for file in index["ply"]] == [True] * kept
    assert not list(folder.rglob("*.part"))


@pytest.mark.parametrize(("duration", "steps"), [(1e-9, 1), (0.005, 1), (0.0124, 2), (3.0, 600)])
def test_a_run_has_whole_steps_and_at_least_one(duration: float, steps: int) -> None:
    assert step_count(mujoco.MjModel.from_xml_string(MODEL), duration) == steps


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_a_duration_that_is_none_is_refused(duration: float) -> None:
    with pytest.raises(InputError, match="--duration"):
        Moving().duration(duration)


@pytest.mark.parametrize(("keyframe", "time", "qpos"), [(None, 0.0, 0.0), ("rolling", 7.0, 1.0)])
def test_a_run_begins_at_the_keyframe(keyframe: str | None, time: float, qpos: float) -> None:
    data = initial_data(mujoco.MjModel.from_xml_string(MODEL), keyframe)
    assert (data.time, data.qpos[0]) == (time, qpos)


def test_on_a_terminal_a_bar_shows_time_and_frames() -> None:
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=100)
    with progress(console, 2.0) as report:
        report(1.5, 12)
    assert "1.50 of 2.00 s  12 frames" in screen.getvalue()
    assert "━" in screen.getvalue()


def test_two_returns_of_each_ray_are_written(folder: Path) -> None:
    (folder / "dual.yaml").write_text(
        RIG.replace("columns: 36", "columns: 36\n    returns: dual\n    max_surfaces: 2\n    pulse_length: 1.0e-10")
    )
    (folder / "cart.xml").write_text(MODEL.replace('size="0.1 3 1"', 'size="0.1 3 1" rgba="1 1 1 0.5"'))
    code, output = run("dual.yaml", "--duration", "0.02", "--out", "o", "--format", "ply,npz")
    assert code == 0, output
    with np.load(folder / "o/top/000000.npz") as frame:
        assert frame["range"].shape == frame["ring"].shape == frame["stamp"].shape == (2, 36, 2)
        assert frame["points"].shape == (2, 36, 2, 3)
        seen = np.isfinite(frame["range"])
        assert seen[..., 1].any()
    assert len(trimesh.load(folder / "o/top/000000.ply").vertices) == seen.sum()
    assert (folder / "o/top/preview.png").is_file()
