"""The folder of a run: its files, the formats of each sensor, and its index."""

import json
from pathlib import Path
from typing import Any

import made_frames
import numpy as np
import pytest
from made_frames import INTRINSICS, POSE, make_frame, random_range

from rigcast.export.frames.npz import write_npz
from rigcast.recording.formats import choose_formats
from rigcast.recording.recorder import Recorder
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lens import BrownConrady, KannalaBrandt, Lens
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.sensor_spec import SensorSpec

LIDAR = Lidar(name="top", mount=Mount(body="crate"), elevation_deg=(-1.0, 1.0), columns=8, min_range=0.5)
CAMERA = DepthCamera(name="eye", mount=Mount(), resolution=(6, 4), fov_y_deg=58)
SCAN = HeightScan(name="feet", mount=Mount(body="crate"), size=(0.4, 0.2), spacing=0.1)
RIG = (LIDAR, CAMERA, SCAN)
SHAPES = {"top": (2, 8), "eye": (4, 6), "feet": (15,)}
KINDS: dict[str, type[Frame]] = {"top": LidarFrame, "eye": CameraFrame, "feet": Frame}


def a_frame(name: str, time: float = 0.1) -> Any:
    (pattern,) = (spec.pattern(made_frames.model()) for spec in RIG if spec.name == name)
    return make_frame(KINDS[name], random_range(SHAPES[name], 3), sensor=name, time=time, pattern=pattern)


def record(
    folder: Path, names: list[str], formats: list[str] | None = None, rig: tuple[SensorSpec, ...] = RIG
) -> Recorder:
    """Write a frame of each of these sensors, 0.1 s apart, to `folder`; return the recorder."""
    recorder = Recorder(folder, made_frames.model(), rig, formats)
    for i, name in enumerate(names):
        recorder.write(a_frame(name, 0.1 * (i + 1)))
    recorder.finish()
    return recorder


def files_in(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize(
    ("formats", "expected"),
    [
        (None, {"top": ("ply",), "eye": ("exr",), "feet": ("ply",)}),
        (["exr", "ply"], {"top": ("ply",), "eye": ("exr", "ply"), "feet": ("ply",)}),
        (["npz"], {"top": ("npz",), "eye": ("npz",), "feet": ("npz",)}),
        (["ply", "ply"], {"top": ("ply",), "eye": ("ply",), "feet": ("ply",)}),
    ],
)
def test_every_sensor_gets_the_formats_that_fit_it(
    formats: list[str] | None, expected: dict[str, tuple[str, ...]]
) -> None:
    assert choose_formats(RIG, formats) == expected


@pytest.mark.parametrize(
    ("formats", "messages"),
    [
        ([], ["got no format, expected any of exr, exr_multipart, png, ply"]),
        (
            ["plx"],
            [
                "no format 'plx', expected any of exr, exr_multipart, png, ply, pcd",
            ],
        ),
        (["lss", "exd"], ["no format 'lss'", "no format 'exd'"]),
        (["exr"], ["sensor 'top' is a lidar", "sensor 'feet' is a height_scan"]),
    ],
)
def test_a_format_that_does_not_fit_is_an_error_that_names_it(formats: list[str], messages: list[str]) -> None:
    with pytest.raises(InputError) as error:
        choose_formats(RIG, formats)
    lines = str(error.value).splitlines()
    assert len(lines) == len(messages)
    for line, message in zip(lines, messages, strict=True):
        assert message in line


def test_the_folder_holds_frames_previews_and_the_index(tmp_path: Path) -> None:
    recorder = record(tmp_path / "new" / "run", ["top", "eye", "top"])
    assert files_in(tmp_path / "new" / "run") == [
        "eye/000000.exr",
        "eye/preview.png",
        "frames.npz",
        "ids.json",
        "top/000000.ply",
        "top/000001.ply",
        "top/preview.png",
    ]
    for name, output in recorder.outputs.items():
        sizes = [path.stat().st_size for path in (recorder.folder / name).iterdir()]
        assert (output.files, output.size) == (len(sizes), sum(sizes)), name
    assert [output.frames for output in recorder.outputs.values()] == [2, 1, 0]


def test_the_index_has_a_row_per_frame(tmp_path: Path) -> None:
    record(tmp_path, ["top", "eye", "top"], ["exr", "ply"])
    with np.load(tmp_path / "frames.npz", allow_pickle=False) as index:
        assert index["sensor"].tolist() == ["top", "eye", "top"]
        assert index["frame"].tolist() == [0, 0, 1]
        assert index["time"].tolist() == [0.1 * k for k in (1, 2, 3)]
        np.testing.assert_array_equal(index["pose"], np.stack([POSE] * 3))
        assert index["exr"].tolist() == ["", "eye/000000.exr", ""]
        assert index["ply"].tolist() == ["top/000000.ply", "eye/000000.ply", "top/000001.ply"]
        assert "npz" not in index
        for column in ("exr", "ply"):
            assert all((tmp_path / file).is_file() for file in index[column] if file)


@pytest.mark.parametrize("names", [[], ["eye"]])
def test_the_index_describes_all_sensors_whether_they_were_due_or_not(tmp_path: Path, names: list[str]) -> None:
    record(tmp_path, names)
    with np.load(tmp_path / "frames.npz", allow_pickle=False) as index:
        assert len(index["sensor"]) == len(index["exr"]) == len(names)
        assert index["pose"].shape == (len(names), 4, 4)
        assert index["sensor_name"].tolist() == ["top", "eye", "feet"]
        assert index["sensor_type"].tolist() == ["lidar", "depth_camera", "height_scan"]
        assert index["sensor_shape"].tolist() == [[2, 8], [4, 6], [15, 0]]
        assert np.isnan(index["sensor_intrinsics"][[0, 2]]).all()
        np.testing.assert_array_equal(index["sensor_intrinsics"][1], CAMERA.pattern(made_frames.model()).intrinsics)
        assert index["geom_name"].tolist() == ["floor", "geom_1", "ball"]
        assert index["geom_body"].tolist() == [0, 1, 2]
        assert index["body_name"].tolist() == ["world", "crate", "body_2"]


@pytest.mark.parametrize("row", range(3))
def test_a_sensor_is_rebuilt_exactly_from_the_index(tmp_path: Path, row: int) -> None:
    record(tmp_path, [])
    with np.load(tmp_path / "frames.npz", allow_pickle=False) as index:
        text = str(index["sensor_spec"][row])
    assert type(RIG[row]).model_validate(json.loads(text)) == RIG[row]
    assert json.loads(text)["max_range"] == np.inf


def test_what_an_earlier_run_left_is_replaced_and_nothing_else_is_touched(tmp_path: Path) -> None:
    record(tmp_path, ["top", "top", "eye"], ["npz"])
    (tmp_path / "top" / "notes.txt").write_text("mine")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "000000.npz").write_text("of another rig")
    record(tmp_path, ["top"], rig=(LIDAR, CAMERA))
    assert files_in(tmp_path) == [
        "frames.npz",
        "ids.json",
        "other/000000.npz",
        "top/000000.ply",
        "top/notes.txt",
        "top/preview.png",
    ]


@pytest.mark.parametrize("name", ["top", "eye", "feet"])
def test_npz_keeps_every_ray(tmp_path: Path, name: str) -> None:
    frame = a_frame(name, time=1700000000.123)
    write_npz(tmp_path / "a", frame)
    own = {"top": {"ring", "column"}, "eye": {"depth", "depth_16bit"}, "feet": set()}[name]
    of_camera = {"depth_scale", "intrinsics"} if name == "eye" else set()
    common = {"range", "points", "normal", "geom_id", "body_id", "stamp"}
    with np.load(tmp_path / "a", allow_pickle=False) as stored:
        assert set(stored) == {"sensor", "time", "pose"} | common | own | of_camera
        for field in common | own:
            np.testing.assert_array_equal(stored[field], getattr(frame, field).numpy(), field)
        assert str(stored["sensor"]) == name
        assert float(stored["time"]) == 1700000000.123
        np.testing.assert_array_equal(stored["pose"], POSE)
        if name == "eye":
            np.testing.assert_array_equal(stored["intrinsics"], INTRINSICS)
            assert stored["depth_scale"] == 0.001


@pytest.mark.parametrize("lens", [BrownConrady(k1=0.1, k2=1 / 3, p2=-1e-9, k6=0.3), KannalaBrandt(k1=-0.1, k4=1 / 7)])
def test_the_lens_is_in_the_npz_and_in_the_index(tmp_path: Path, lens: Lens) -> None:
    write_npz(tmp_path / "a", make_frame(CameraFrame, random_range((4, 6), 3), lens=lens))
    with np.load(tmp_path / "a", allow_pickle=False) as stored:
        assert str(stored["distortion_model"]) == lens.type
        np.testing.assert_array_equal(stored["distortion"], lens.coefficients)
    bent = DepthCamera(name="eye", mount=Mount(), resolution=(6, 4), fx=9.0, fy=9.0, cx=3.0, cy=2.0, distortion=lens)
    record(tmp_path, ["eye"], rig=(LIDAR, bent))
    with np.load(tmp_path / "frames.npz", allow_pickle=False) as index:
        assert index["sensor_distortion_model"].tolist() == ["", lens.type]
        count = lens.coefficients.size
        np.testing.assert_array_equal(index["sensor_distortion"][1, :count], lens.coefficients)
        assert np.isnan(index["sensor_distortion"][1, count:]).all()
        assert np.isnan(index["sensor_distortion"][0]).all()


def test_a_failing_frame_leaves_no_file(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, made_frames.model(), RIG)
    (tmp_path / "eye").rmdir()
    (tmp_path / "eye").write_text("in the way")
    with pytest.raises(InputError, match=r"000000\.exr: cannot be written"):
        recorder.write(a_frame("eye"))
    recorder.finish()
    assert files_in(tmp_path) == ["eye", "frames.npz", "ids.json"]
