"""Recordings that are long, interrupted, killed, or out of disk space."""

import gc
import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import tracemalloc
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import laspy
import made_frames
import mujoco
import numpy as np
import OpenEXR
import pytest
import zarr
from made_frames import make_frame, random_range
from mcap.exceptions import McapError
from ros_bags import read_bag, read_mcap, read_sqlite

import rigcast
from rigcast.export import files
from rigcast.recording.formats import FORMATS
from rigcast.recording.recorder import Recorder
from rigcast.sensors.rig.frame import CameraFrame, LidarFrame

LIDAR = rigcast.Lidar(name="top", mount=rigcast.Mount(body="crate"), elevation_deg=(-1.0, 1.0), columns=8)
CAMERA = rigcast.DepthCamera(name="eye", mount=rigcast.Mount(), resolution=(6, 4), fov_y_deg=58)
RIG = (LIDAR, CAMERA)
RUN_FORMATS = ["zarr", "mcap", "sqlite3"]
ALL = list(FORMATS)


def frames_at(time: float) -> list[Any]:
    pattern = LIDAR.pattern(made_frames.model())
    lidar = make_frame(LidarFrame, random_range((2, 8), 1), sensor="top", time=time, pattern=pattern)
    return [lidar, make_frame(CameraFrame, random_range((4, 6), 2), sensor="eye", time=time)]


def indexed(folder: Path) -> list[tuple[str, int]]:
    with np.load(folder / "frames.npz") as index:
        return list(zip(index["sensor"].tolist(), index["frame"].tolist(), strict=True))


def clouds_in(folder: Path) -> int:
    return sum(read.topic == "/top/points" for read in read_bag(folder))


def rows_in(folder: Path) -> int:
    group: Any = zarr.open_group(store=str(folder), mode="r")["top"]
    return int(np.isfinite(group["time"][:]).sum())


def test_one_run_can_be_written_in_every_format(tmp_path: Path) -> None:
    with Recorder(tmp_path, made_frames.model(), RIG, ALL) as recorder:
        for k in range(3):
            recorder.step(mujoco.MjData(made_frames.model()), frames_at(0.1 * k))
    files_of = {"top": ".bin .label .las .laz .npz .pcd .pcd.bin .ply _lidarseg.bin"}
    files_of["eye"] = f"{files_of['top']} .exr .png"
    for sensor, suffixes in files_of.items():
        expected = {f"{k:06d}{suffix}" for k in range(3) for suffix in suffixes.split()} | {"preview.png"}
        assert {path.name for path in (tmp_path / sensor).iterdir()} == expected, sensor
    assert sorted(path.name for path in (tmp_path / "cameras").iterdir()) == [f"{k:06d}.exr" for k in range(3)]
    for suffix in ("las", "laz"):
        with laspy.open(tmp_path / "top" / f"000000.{suffix}") as reader:
            assert reader.header.are_points_compressed == (suffix == "laz")
    assert clouds_in(tmp_path / "rosbag2_mcap") == clouds_in(tmp_path / "rosbag2_sqlite3") == 3
    assert rows_in(tmp_path / "frames.zarr") == 3
    assert not (tmp_path / "unfinished").exists()
    table = json.loads((tmp_path / "ids.json").read_text())
    assert table["geom_name"] == ["floor", "geom_1", "ball"]


def test_cameras_of_one_time_share_a_file_and_others_do_not(tmp_path: Path) -> None:
    rig = [CAMERA, CAMERA.model_copy(update={"name": "rear"})]
    data = mujoco.MjData(made_frames.model())
    with Recorder(tmp_path, made_frames.model(), rig, ["exr_multipart"]) as recorder:
        for times in ((0.1, 0.1), (0.2, 0.3)):
            pair = [
                make_frame(CameraFrame, random_range((4, 6), 2), sensor=spec.name, time=time)
                for spec, time in zip(rig, times, strict=True)
            ]
            recorder.step(data, pair)
    parts = [[part.name() for part in OpenEXR.File(str(p)).parts] for p in sorted((tmp_path / "cameras").iterdir())]
    assert parts == [["eye", "rear"], ["eye"], ["rear"]]
    with np.load(tmp_path / "frames.npz") as index:
        assert index["exr_multipart"].tolist() == [f"cameras/00000{k}.exr" for k in (0, 0, 1, 2)]


def test_two_frames_of_one_sensor_in_one_step_are_two_files(tmp_path: Path) -> None:
    with Recorder(tmp_path, made_frames.model(), [LIDAR], ["npz"]) as recorder:
        recorder.step(mujoco.MjData(made_frames.model()), [frames_at(0.1)[0], frames_at(0.2)[0]])
    assert indexed(tmp_path) == [("top", 0), ("top", 1)]
    times = [float(np.load(tmp_path / "top" / f"{k:06d}.npz")["time"]) for k in range(2)]
    assert times == [0.1, 0.2]


def test_a_second_run_takes_the_place_of_the_first(tmp_path: Path) -> None:
    for count in (3, 1):
        with Recorder(tmp_path, made_frames.model(), RIG, ["exr_multipart", "ply", *RUN_FORMATS]) as recorder:
            for k in range(count):
                recorder.step(mujoco.MjData(made_frames.model()), frames_at(0.1 * k))
    assert len(list((tmp_path / "cameras").iterdir())) == 1
    assert clouds_in(tmp_path / "rosbag2_mcap") == rows_in(tmp_path / "frames.zarr") == 1


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ({"top": frames_at(0.1)[0]}, "got dict, expected a list of frames, such as its values"),
        (frames_at(0.1)[0], "got LidarFrame, expected a list of frames$"),
        (None, "got NoneType, expected a list of frames$"),
        (["top"], "got str, expected Frame$"),
        (frames_at(0.1), "no sensor 'eye', expected one of top$"),
    ],
)
def test_what_are_no_frames_of_its_sensors_is_refused(tmp_path: Path, frames: Any, message: str) -> None:
    data = mujoco.MjData(made_frames.model())
    with Recorder(tmp_path, made_frames.model(), [LIDAR], ["npz"]) as recorder:
        with pytest.raises(rigcast.InputError, match=f"^Recorder: frames: {message}"):
            recorder.step(data, frames)
        recorder.step(data, frames_at(0.1)[:1])
    assert indexed(tmp_path) == [("top", 0)]


def test_a_recorder_finishes_once_and_takes_no_frame_after_that(tmp_path: Path) -> None:
    data = mujoco.MjData(made_frames.model())
    with Recorder(tmp_path, made_frames.model(), [LIDAR], ["npz", "mcap"]) as recorder:
        recorder.step(data, frames_at(0.1)[:1])
        recorder.finish()
    with pytest.raises(
        rigcast.InputError, match="Recorder: already finished, expected a new one for more frames; 1 frames"
    ):
        recorder.step(data, frames_at(0.2)[:1])
    assert indexed(tmp_path) == [("top", 0)]
    assert sorted(path.name for path in (tmp_path / "top").iterdir()) == ["000000.npz", "preview.png"]


def test_a_frame_that_fails_in_one_format_is_saved_in_none(tmp_path: Path) -> None:
    data = mujoco.MjData(made_frames.model())
    with Recorder(tmp_path, made_frames.model(), [CAMERA], ["ply", "exr_multipart"]) as recorder:
        recorder.step(data, frames_at(0.1)[1:])
        (tmp_path / "cameras" / "000002.exr").mkdir()
        with pytest.raises(
            rigcast.InputError, match=r"000002\.exr: cannot be written: .*; 1 frames from before are in"
        ):
            recorder.step(data, [frames_at(0.2)[1], frames_at(0.3)[1]])
    assert indexed(tmp_path) == [("eye", 0)]
    files = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("0*") if path.is_file()]
    assert sorted(files) == ["cameras/000000.exr", "eye/000000.ply"]


def test_a_recording_that_cannot_be_completed_is_told_when_all_else_is_saved(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, made_frames.model(), [LIDAR], ["npz", "mcap", "zarr"])
    recorder.step(mujoco.MjData(made_frames.model()), frames_at(0.1)[:1])
    (tmp_path / "rosbag2_mcap" / "another").mkdir(parents=True)
    message = "unfinished/rosbag2_mcap: cannot be completed: Directory not empty; 1 frames from before are in"
    with pytest.raises(rigcast.InputError, match=message):
        recorder.finish()
    assert indexed(tmp_path) == [("top", 0)]
    assert rows_in(tmp_path / "frames.zarr") == 1
    assert (tmp_path / "top" / "preview.png").exists()
    assert clouds_in(tmp_path / "unfinished" / "rosbag2_mcap") == 1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"formats": "npz"}, r"formats: got 'npz', expected a list of names, such as \['npz'\]"),
        ({"formats": 3}, "formats: got 3, expected a list of names"),
        ({"folder": 3}, "Recorder: folder: got int, expected str or Path"),
        ({"model": RIG}, "Recorder: model: got tuple, expected MjModel"),
        ({"sensors": {"top": LIDAR}}, "Recorder: sensors: got dict, expected Sequence"),
        ({"sensors": ["top"]}, r"Recorder: sensors\[0\]: got str, expected SensorSpec"),
        ({"options": {"exr_compression": "piz"}}, "Recorder: options: got dict, expected Export or None"),
        ({"props": "crate"}, r"props\[0\]: got str, expected Prop"),
        ({"classes": ["floor"]}, "classes: got list, expected Mapping"),
        ({"classes": {"ground": "floor"}}, "classes: ground: got 'floor', expected a list of names"),
    ],
)
def test_what_no_recorder_can_be_made_of_is_refused(tmp_path: Path, given: dict[str, Any], message: str) -> None:
    how: dict[str, Any] = {"folder": tmp_path / "o", "model": made_frames.model(), "sensors": RIG, **given}
    with pytest.raises(rigcast.InputError, match=message):
        Recorder(**how)
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("name", ["cameras", "unfinished", "rosbag2_mcap"])
def test_a_sensor_called_like_another_part_of_the_folder_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(rigcast.InputError, match=f"sensor '{name}': the name of another part of the output folder"):
        Recorder(tmp_path / "o", made_frames.model(), [LIDAR.model_copy(update={"name": name})])
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(("name", "most"), [("las", 192), ("nuscenes", 255)])
def test_more_classes_than_a_format_has_numbers_for_are_refused(tmp_path: Path, name: str, most: int) -> None:
    geoms = "".join(f"<geom name='g{k}' size='1'/>" for k in range(most + 1))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    classes = {f"c{k}": [f"g{k}"] for k in range(most + 1)}
    lidar = LIDAR.model_copy(update={"mount": rigcast.Mount()})
    with pytest.raises(rigcast.InputError, match=f"{name} holds at most {most} classes, got {most + 1}"):
        Recorder(tmp_path / "o", model, [lidar], [name], classes=classes)
    Recorder(tmp_path / "o", model, [lidar], [name], classes={"c": ["g*"]}).finish()


@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [
        ("pcd", "pypcd4", "pcd"),
        ("las", "laspy", "las"),
        ("laz", "lazrs", "las"),
        ("zarr", "zarr", "zarr"),
        ("mcap", "rosbags", "ros"),
        ("sqlite3", "rosbags", "ros"),
    ],
)
def test_a_library_that_is_missing_is_named_with_what_brings_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, module: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    message = rf"^format {name} needs {module}, which is not installed; pip install 'rigcast\[{extra}\]' brings it"
    with pytest.raises(rigcast.InputError, match=message):
        Recorder(tmp_path, made_frames.model(), RIG, [name, "ply"])


@pytest.mark.usefixtures("no_older_objects")
@pytest.mark.parametrize("name", ALL)
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, name: str) -> None:
    """A frame takes 4 kB here. What stays in memory is an MCAP's index, 235 bytes per frame, written at its end."""
    rig = [CAMERA] if FORMATS[name].images_only else [LIDAR]
    data = mujoco.MjData(made_frames.model())
    recorder = Recorder(tmp_path, made_frames.model(), rig, [name])

    def record(count: int) -> None:
        for _ in range(count):
            data.time += 0.1
            recorder.step(data, [frame for frame in frames_at(data.time) if frame.sensor == rig[0].name])

    traced = []
    tracemalloc.start()
    for frames in (25, 50, 50, 50):
        record(frames)
        gc.collect()
        traced.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    recorder.finish()
    # the least, as what is allocated once, by whatever runs in this process, is in one of them
    assert min(np.diff(traced)) / 50 < 600, (name, traced)


# A run in its own process: writes frames to the folder given, and does what is asked after the third step.
PROGRAM = """
import os, signal, sys
sys.path[:0] = {folders!r}
import mujoco, made_frames
from test_recording import RIG, frames_at
from rigcast.recording.recorder import Recorder

data = mujoco.MjData(made_frames.model())
recorder = Recorder(sys.argv[1], made_frames.model(), RIG, ["ply", "exr_multipart", "zarr", "mcap", "sqlite3"])
for k in range(5):
    if k == 3:
        {then}
    data.time = 0.1 * k
    recorder.step(data, frames_at(data.time))
"""


def run_program(folder: Path, then: str) -> int:
    folders = [str(Path(module).parent) for module in (__file__, made_frames.__file__)]
    program = PROGRAM.format(folders=folders, then=then)
    command = [sys.executable, "-c", textwrap.dedent(program), str(folder)]
    return subprocess.run(command, capture_output=True, timeout=120).returncode


def test_a_run_that_is_killed_leaves_every_finished_frame_readable(tmp_path: Path) -> None:
    assert run_program(tmp_path, "os.kill(os.getpid(), signal.SIGKILL)") == -signal.SIGKILL
    rows = [json.loads(line) for line in (tmp_path / "frames.jsonl").read_text().splitlines()]
    assert [(row["sensor"], row["frame"]) for row in rows] == [(s, k) for k in range(3) for s in ("top", "eye")]
    for row in rows:
        for file in row["files"].values():
            assert (tmp_path / file).stat().st_size > 0
    assert not list(tmp_path.rglob("*.part"))
    assert not (tmp_path / "rosbag2_mcap").exists()
    unfinished = tmp_path / "unfinished"
    assert rows_in(unfinished / "frames.zarr") == 3
    stored = list(read_sqlite(unfinished / "rosbag2_sqlite3" / "rosbag2_sqlite3.db3"))
    assert sum(read.topic == "/top/points" for read in stored) == 3
    found = []
    with suppress(McapError):  # the end is missing
        for read in read_mcap(unfinished / "rosbag2_mcap" / "rosbag2_mcap.mcap"):
            found.append(read)
    assert [(r.topic, r.nanoseconds) for r in found] == [(r.topic, r.nanoseconds) for r in stored]


@pytest.fixture
def ctrl_c_interrupts() -> Iterator[None]:
    """Make Ctrl-C interrupt, also in a process that was started in the background, which ignores it."""
    usual = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, usual)


def interrupting(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Press Ctrl-C while the second frame is being written in a format."""
    module: Any = import_module("rigcast.export.frames.ply")
    usual, calls = getattr(module, name), [0]

    def export(*args: Any, **kwargs: Any) -> Any:
        calls[0] += 1
        if calls[0] == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return usual(*args, **kwargs)

    monkeypatch.setattr(module, name, export)


@pytest.mark.usefixtures("ctrl_c_interrupts")
def test_ctrl_c_waits_until_the_frame_is_whole_in_every_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interrupting("export_ply", monkeypatch)
    data = mujoco.MjData(made_frames.model())

    def record() -> None:
        with Recorder(tmp_path, made_frames.model(), [LIDAR], ["ply", *RUN_FORMATS]) as recorder:
            for k in range(5):
                recorder.step(data, frames_at(0.1 * k)[:1])

    with pytest.raises(KeyboardInterrupt):
        record()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert indexed(tmp_path) == [("top", 0), ("top", 1)]
    assert sorted(path.name for path in (tmp_path / "top").glob("*.ply")) == ["000000.ply", "000001.ply"]
    assert rows_in(tmp_path / "frames.zarr") == clouds_in(tmp_path / "rosbag2_mcap") == 2
    assert clouds_in(tmp_path / "rosbag2_sqlite3") == 2


@pytest.mark.usefixtures("ctrl_c_interrupts")
def test_a_second_ctrl_c_does_not_wait() -> None:
    def press_twice() -> None:
        with files.uninterrupted():
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)
            pytest.fail("went on after the second Ctrl-C")

    with pytest.raises(KeyboardInterrupt):
        press_twice()


def test_a_disk_that_fills_up_is_reported_with_what_was_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    data = mujoco.MjData(made_frames.model())

    def record() -> None:
        with Recorder(tmp_path, made_frames.model(), RIG, ["ply", *RUN_FORMATS]) as recorder:
            recorder.step(data, frames_at(0.1))
            monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=2**20))
            recorder.step(data, frames_at(0.2))

    message = rf"{tmp_path}: cannot be written: No space left on device; 2 frames from before are in {tmp_path}"
    with pytest.raises(rigcast.InputError, match=message):
        record()
    assert indexed(tmp_path) == [("top", 0), ("eye", 0)]
    assert clouds_in(tmp_path / "rosbag2_mcap") == rows_in(tmp_path / "frames.zarr") == 1


def test_a_large_frame_needs_more_room_than_a_small_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, usage = mujoco.MjData(made_frames.model()), shutil.disk_usage(tmp_path)
    large = make_frame(LidarFrame, np.ones((2, 500_000), np.float32), sensor="top")
    with Recorder(tmp_path, made_frames.model(), [LIDAR], ["npz"]) as recorder:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=2**27))
        recorder.step(data, frames_at(0.1)[:1])
        with pytest.raises(rigcast.InputError, match="No space left on device; 1 frames from before"):
            recorder.step(data, [large])
    assert indexed(tmp_path) == [("top", 0)]


FULL_DISK = """
set -e
mkdir disk
mount -t tmpfs -o size=40m tmpfs disk
trap 'status=$?; cp -r disk/out kept; umount disk; exit $status' EXIT
{command}
"""


def test_a_really_full_disk_leaves_complete_files(tmp_path: Path) -> None:
    """A run on a file system of 40 MB; skipped where the user may not mount one."""
    (tmp_path / "room.xml").write_text(made_frames.MODEL_XML)
    (tmp_path / "rig.yaml").write_text(
        "model: room.xml\n"
        "sensors: [{name: top, type: lidar, mount: {pos: [0, 0, 1]}, elevation_deg: [-30, -20, -10], columns: 4000}]\n"
    )
    if subprocess.run(["unshare", "-rm", "mount", "-t", "tmpfs", "tmpfs", tmp_path], capture_output=True).returncode:
        pytest.skip("this user may not mount a file system of their own")
    rigcast_run = f"{Path(sys.executable).parent / 'rigcast'} run rig.yaml --duration 2 --out disk/out --device cpu"
    script = FULL_DISK.format(command=f"{rigcast_run} --format npz,mcap,sqlite3")
    done = subprocess.run(
        ["unshare", "-rm", "bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 2, done.stdout + done.stderr
    assert "No space left on device" in done.stderr
    count = len(indexed(tmp_path / "kept"))
    assert 0 < count < 1000
    assert f"{count} frames from before are in disk/out" in done.stderr
    assert len(list((tmp_path / "kept" / "top").glob("*.npz"))) == count
    assert clouds_in(tmp_path / "kept" / "rosbag2_mcap") == clouds_in(tmp_path / "kept" / "rosbag2_sqlite3") == count
