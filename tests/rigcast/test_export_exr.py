import json
from pathlib import Path
from typing import Any

import made_frames
import numpy as np
import OpenEXR
import pytest
from made_frames import INTRINSICS, POSE, make_frame, random_range

from rigcast.export.exr import write_exr
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
        "body_name": ["world", "crate", "body_2"],
    }
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION


def test_a_file_that_cannot_be_written_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"a\.exr"):
        write_exr(tmp_path / "missing" / "a.exr", make_frame(CameraFrame, random_range((2, 2), 0)), IDS)
