from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from made_frames import make_frame, random_range

from rigcast.export.frames.ply import write_ply
from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame

COMMON = {
    "x": "<f4",
    "y": "<f4",
    "z": "<f4",
    "nx": "<f4",
    "ny": "<f4",
    "nz": "<f4",
    "geom_id": "<i4",
    "body_id": "<i4",
    "stamp": "<f8",
}
LIDAR = COMMON | {"ring": "<i4", "column": "<i4"}


def write_and_read(path: Path, frame: Frame) -> np.ndarray[Any, Any]:
    """Write a frame and read its vertices with trimesh: one record per point."""
    write_ply(path, frame)
    cloud = trimesh.load(path)
    raw = cloud.metadata["_ply_raw"]["vertex"]
    assert raw["length"] == len(raw["data"]) == len(cloud.vertices)
    records: np.ndarray[Any, Any] = raw["data"]
    return records


@pytest.mark.parametrize(
    ("kind", "shape", "properties"),
    [
        (LidarFrame, (16, 90), LIDAR),
        (LidarFrame, (1, 40), LIDAR),
        (CameraFrame, (12, 9), COMMON),
        (Frame, (77,), COMMON),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_points_with_a_range_come_back_exactly(
    tmp_path: Path, kind: type[Frame], shape: tuple[int, ...], properties: dict[str, str], seed: int
) -> None:
    frame = make_frame(kind, random_range(shape, seed))
    records = write_and_read(tmp_path / "a.ply", frame)
    assert {name: records.dtype[name].str for name in records.dtype.names or ()} == properties
    hit = np.isfinite(frame.range.numpy())
    assert 0 < len(records) == np.count_nonzero(hit) < hit.size
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(records[name], frame.points.numpy()[hit][:, axis], f"{name}, seed {seed}")
        np.testing.assert_array_equal(records["n" + name], frame.normal.numpy()[hit][:, axis], f"seed {seed}")
    for name in properties.keys() & {"ring", "column", "geom_id", "body_id", "stamp"}:
        np.testing.assert_array_equal(records[name], getattr(frame, name).numpy()[hit], f"{name}, seed {seed}")


def test_a_unix_stamp_keeps_its_fraction(tmp_path: Path) -> None:
    stamp = np.array([[1700000000.123, 1700000000.1234567]])
    frame = make_frame(LidarFrame, np.array([[1.0, 2.0]], dtype=np.float32), stamp=stamp)
    assert write_and_read(tmp_path / "a.ply", frame)["stamp"].tolist() == stamp[0].tolist()


@pytest.mark.parametrize("miss", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("kind", [LidarFrame, CameraFrame])
def test_a_frame_without_any_range_is_a_cloud_of_no_points(tmp_path: Path, kind: type[Frame], miss: float) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, make_frame(kind, np.full((4, 8), miss, dtype=np.float32)))
    lines = path.read_text("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert "element vertex 0" in lines
    assert lines[-1] == "end_header"
    assert trimesh.load(path).is_empty


def test_a_file_that_cannot_be_written_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_ply(tmp_path / "missing" / "a.ply", make_frame(Frame, random_range((3,), 0)))
