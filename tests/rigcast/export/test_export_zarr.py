import json
from pathlib import Path
from typing import Any

import made_frames
import numpy as np
import pytest
import zarr
from made_frames import INTRINSICS, POSE, make_frame, random_range

from rigcast.export import zarr_store
from rigcast.export.ids import IdTable
from rigcast.export.zarr_store import ZarrStore
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, LidarFrame
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount

IDS = IdTable.of(made_frames.model(), {"ground": ["floor"]})
LIDAR = Lidar(name="top", mount=Mount(), elevation_deg=(-1.0, 1.0), columns=8)
CAMERA = DepthCamera(name="eye", mount=Mount(), resolution=(6, 4), fov_y_deg=58)


def lidar_frames(count: int) -> list[Any]:
    return [make_frame(LidarFrame, random_range((2, 8), k), sensor="top", time=0.1 * k) for k in range(count)]


def camera_frame() -> Any:
    return make_frame(CameraFrame, random_range((4, 6), 0), sensor="eye")


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zarr_store, "_BLOCK", 2)


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("count", [1, 2, 5])
def test_every_frame_is_a_row(tmp_path: Path, count: int) -> None:
    frames = lidar_frames(count)
    store = ZarrStore(tmp_path / "a.zarr", [LIDAR, CAMERA], IDS)
    store.step(None, [*frames, camera_frame()])
    store.close()
    root: Any = zarr.open_group(store=str(tmp_path / "a.zarr"), mode="r")
    fields = {"range", "points", "normal", "geom_id", "body_id", "stamp", "ring", "column"}
    assert set(root["top"].array_keys()) == fields | {"time", "pose"}
    for name in fields:
        expected = np.stack([getattr(frame, name).numpy() for frame in frames])
        np.testing.assert_array_equal(root["top"][name][:], expected, name)
        assert root["top"][name].chunks == (1, *expected.shape[1:]), name
    assert root["top"]["time"][:].tolist() == [frame.time for frame in frames]
    np.testing.assert_array_equal(root["top"]["pose"][:], [POSE] * count)
    np.testing.assert_array_equal(root["eye"].attrs["intrinsics"], INTRINSICS)
    assert root.attrs["ids"] == IDS.lists()
    assert Lidar.model_validate(json.loads(root["top"].attrs["spec"])) == LIDAR


@pytest.mark.usefixtures("small_blocks")
def test_a_store_that_was_not_closed_has_every_frame_and_marks_empty_rows(tmp_path: Path) -> None:
    frames = lidar_frames(3)
    ZarrStore(tmp_path / "a.zarr", [LIDAR], IDS).step(None, frames)
    group: Any = zarr.open_group(store=str(tmp_path / "a.zarr"), mode="r")["top"]
    times = group["time"][:]
    assert np.isfinite(times).tolist() == [True, True, True, False]
    np.testing.assert_array_equal(group["range"][:3], np.stack([frame.range.numpy() for frame in frames]))


def test_a_frame_of_another_shape_is_refused(tmp_path: Path) -> None:
    store = ZarrStore(tmp_path / "a.zarr", [LIDAR], IDS)
    store.step(None, lidar_frames(1))
    with pytest.raises(InputError, match=r"zarr: sensor 'top': got a frame of .*\(3, 8\).* like its first"):
        store.step(None, [make_frame(LidarFrame, random_range((3, 8), 0), sensor="top")])
