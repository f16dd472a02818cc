import json
from pathlib import Path
from typing import Any

import made_frames
import numpy as np
import OpenEXR
import pytest
from made_frames import INTRINSICS, POSE, make_frame, random_range

from rigcast.export.frames.exr import write_exr
from rigcast.export.ids import IdTable
from rigcast.sensors.rig.frame import CameraFrame
from rigcast.sensors.specs.lens import BrownConrady, KannalaBrandt, Lens

IDS = IdTable.of(made_frames.model())


def write_and_read(path: Path, frame: CameraFrame) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
    write_exr(path, frame, IDS)
    file = OpenEXR.File(str(path), separate_channels=True)
    return file.header(), {name: channel.pixels for name, channel in file.channels().items()}


def bits(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.ascontiguousarray(array).view(np.uint32)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 7), (5, 3), (48, 64)])
@pytest.mark.parametrize("seed", range(3))
def test_every_channel_comes_back_bit_for_bit(tmp_path: Path, height: int, width: int, seed: int) -> None:
    frame = make_frame(CameraFrame, random_range((height, width), seed))
    _, channels = write_and_read(tmp_path / "a.exr", frame)
    normal = frame.normal.numpy()
    expected = {
        "Z": frame.depth.numpy(),
        "range": frame.range.numpy(),
        "normal.X": normal[..., 0],
        "normal.Y": normal[..., 1],
        "normal.Z": normal[..., 2],
        "geom_id": frame.geom_id.numpy().view(np.uint32),
        "body_id": frame.body_id.numpy().view(np.uint32),
    }
    assert channels.keys() == expected.keys()
    for name, array in expected.items():
        assert channels[name].dtype == (np.uint32 if name.endswith("_id") else np.float32), name
        np.testing.assert_array_equal(bits(channels[name]), bits(array), err_msg=f"{name}, seed {seed}")


@pytest.mark.parametrize("miss", [np.inf, -np.inf, np.nan])
def test_a_pixel_without_range_keeps_its_kind_and_has_the_miss_id(tmp_path: Path, miss: float) -> None:
    frame = make_frame(CameraFrame, np.array([[miss, 2.0]], dtype=np.float32))
    _, channels = write_and_read(tmp_path / "a.exr", frame)
    np.testing.assert_array_equal(channels["range"], [[np.float32(miss), 2.0]])
    assert channels["geom_id"][0, 0] == channels["body_id"][0, 0] == 4294967295
    assert channels["geom_id"][0, 1] < 3


@pytest.mark.parametrize("time", [0.0, 0.1, 1 / 3, 1700000000.123, 1e-9])
def test_numbers_in_the_header_are_exact(tmp_path: Path, time: float) -> None:
    header, _ = write_and_read(tmp_path / "a.exr", make_frame(CameraFrame, random_range((4, 6), 0), time=time))
    assert header["time"].tolist() == [time]
    for name, matrix in (("pose", POSE), ("intrinsics", INTRINSICS)):
        assert header[name].dtype == np.float64
        np.testing.assert_array_equal(header[name], matrix)


@pytest.mark.parametrize("lens", [BrownConrady(k1=0.1, k2=1 / 3, p2=-1e-9, k6=0.3), KannalaBrandt(k1=-0.1, k4=1 / 7)])
def test_the_lens_is_exact(tmp_path: Path, lens: Lens) -> None:
    header, _ = write_and_read(tmp_path / "a.exr", make_frame(CameraFrame, random_range((4, 6), 0), lens=lens))
    assert header["distortion_model"] == lens.type
    names = (
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6") if lens.type == "brown_conrady" else ("k1", "k2", "k3", "k4")
    )
    assert [header[f"distortion_{name}"].item() for name in names] == lens.coefficients.tolist()


def test_a_pinhole_has_no_distortion(tmp_path: Path) -> None:
    header, _ = write_and_read(tmp_path / "a.exr", make_frame(CameraFrame, random_range((4, 6), 0)))
    assert not [name for name in header if "distortion" in name]


def test_the_header_says_what_the_numbers_mean(tmp_path: Path) -> None:
    header, _ = write_and_read(tmp_path / "a.exr", make_frame(CameraFrame, random_range((4, 6), 0)))
    assert header["sensor"] == "eye"
    assert header["units"].startswith("metres")
    assert "optical frame" in header["conventions"]
    assert json.loads(header["ids"]) == {
        "geom_name": ["floor", "geom_1", "ball"],
        "geom_body": [0, 1, 2],
        "geom_class": [0, 0, 0],
        "body_name": ["world", "crate", "body_2"],
        "class_name": [""],
        **{f"{kind}_{what}": [] for kind in ("flex", "skin", "prop") for what in ("name", "class")},
        "prop_body": [],
    }
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION


@pytest.mark.parametrize("compression", ["none", "rle", "zips", "zip", "piz"])
def test_every_compression_is_without_loss(tmp_path: Path, compression: str) -> None:
    frame = make_frame(CameraFrame, random_range((33, 17), 1))
    write_exr(tmp_path / "a.exr", frame, IDS, compression)
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    wanted = "NO" if compression == "none" else compression.upper()
    assert file.header()["compression"] == getattr(OpenEXR, f"{wanted}_COMPRESSION")
    np.testing.assert_array_equal(bits(file.channels()["Z"].pixels), bits(frame.depth.numpy()))


def test_several_cameras_are_parts_of_one_file_each_with_its_own_size_and_header(tmp_path: Path) -> None:
    shapes = {"left": (4, 6), "right": (5, 3)}
    frames = [make_frame(CameraFrame, random_range(shape, 2), sensor=name) for name, shape in shapes.items()]
    write_exr(tmp_path / "a.exr", frames, IDS)
    parts = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).parts
    assert [part.name() for part in parts] == ["left", "right"]
    for part, frame in zip(parts, frames, strict=True):
        assert part.header["sensor"] == frame.sensor
        assert np.array(part.header["displayWindow"]).tolist() == [[0, 0], [5, 4]], "of the largest width and height"
        assert part.header["time"].tolist() == [frame.time]
        np.testing.assert_array_equal(bits(part.channels["range"].pixels), bits(frame.range.numpy()), frame.sensor)


def test_fields_that_only_some_frames_have_are_channels_too(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    given = {"intensity": rng.random((4, 6)).astype(np.float32), "flex_id": rng.integers(-1, 3, (4, 6), np.int32)}
    _, channels = write_and_read(tmp_path / "a.exr", make_frame(CameraFrame, random_range((4, 6), 0), **given))
    np.testing.assert_array_equal(channels["intensity"], given["intensity"])
    np.testing.assert_array_equal(channels["flex_id"].view(np.int32), given["flex_id"])


def test_a_file_that_cannot_be_written_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"a\.exr"):
        write_exr(tmp_path / "missing" / "a.exr", make_frame(CameraFrame, random_range((2, 2), 0)), IDS)
