"""Frames of a data set come back by their number, as they were written, or it is said what is wrong."""

import pickle
import shutil
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

import numpy as np
import pytest

import rigcast
from rigcast.sensors.errors import InputError

from .small_datasets import edited, make


def test_frames_come_episode_by_episode_in_the_order_of_time(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder)
    keys = [(f.scene, f.episode, round(f.time, 3), f.sensor) for f in frames]
    times = {"top": [0.02, 0.04, 0.06, 0.08, 0.1], "front": [0.04, 0.08]}
    expected = [
        (scene, k, time, sensor)
        for scene in ("room", "made")
        for k in (0, 1)
        for time in times["top"]
        for sensor in ("top", "front")
        if time in times[sensor]
    ]
    assert keys == expected
    assert len(frames) == len(expected)
    assert frames[-1].time == frames[len(frames) - 1].time
    assert [f.time for f in frames[2:5]] == [frames[k].time for k in (2, 3, 4)]
    with pytest.raises(IndexError):
        frames[len(frames)]


def test_a_frame_has_what_its_sensor_gives(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder)
    (top,), (front,) = frames.of("top")[:1], frames.of("front")[:1]
    assert top["range"].shape == (2, 36)
    assert front["depth"].shape == (6, 8)
    assert front["intrinsics"].shape == (3, 3)
    assert top["pose"].shape == (4, 4)
    assert float(top["time"]) == top.time
    assert {"range", "points", "ring", "intensity", "geom_id", "stamp"} <= set(top)
    assert "intrinsics" not in top
    with pytest.raises(KeyError):
        top["depht"]


def test_zarr_holds_the_same_as_npz(path: Path, whole_folder: Path) -> None:
    path.write_text(path.read_text() + "output: {format: zarr}\n")
    make(path)
    packed, plain = rigcast.open_dataset(path.parent / "out", verify=True), rigcast.open_dataset(whole_folder)
    assert len(packed) == len(plain)
    for one, other in zip(packed, plain, strict=True):
        assert (one.sensor, one.time, one.seed, set(one)) == (other.sensor, other.time, other.seed, set(other))
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_a_sensor_that_is_not_there_is_named(whole_folder: Path) -> None:
    with pytest.raises(InputError, match="no sensor 'tpo', expected one of top, front; did you mean 'top'"):
        rigcast.open_dataset(whole_folder).of("tpo")


def test_statistics_are_those_of_the_frames(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder)
    for name in ("top", "front"):
        ranges = np.concatenate([f["range"].ravel() for f in frames.of(name)])
        hits = ranges[np.isfinite(ranges)].astype(np.float64)
        one = frames.manifest["statistics"][name]
        assert (one["frames"], one["rays"], one["hits"]) == (len(frames.of(name)), ranges.size, hits.size)
        np.testing.assert_allclose(one["range"], [hits.min(), hits.mean(), hits.max()], atol=1e-6)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda file: file.unlink(), "missing"),
        (lambda file: file.write_bytes(file.read_bytes()[:-1]), "got another checksum"),
        (lambda file: file.write_bytes(file.read_bytes()[:-1] + b"!"), "got another checksum"),
    ],
)
def test_a_file_that_is_not_as_it_was_written_is_found(
    tmp_path: Path, whole_folder: Path, harm: Any, message: str
) -> None:
    shutil.copytree(whole_folder, tmp_path / "copy")
    assert rigcast.open_dataset(tmp_path / "copy", verify=True).verify() == []
    harm(tmp_path / "copy/room/000001/frames.npz")
    (fault,) = rigcast.open_dataset(tmp_path / "copy").verify()
    assert "room/000001/frames.npz" in fault
    assert message in fault
    with pytest.raises(InputError, match=message):
        rigcast.open_dataset(tmp_path / "copy", verify=True)


def test_a_scene_whose_meshes_changed_meanwhile_is_found(path: Path) -> None:
    edited(path, "  - {name: made,", "  - {name: lone, file: lone.xml}\n  - {name: made,")
    (path.parent / "lone.xml").write_text('<mujoco><include file="room.xml"/></mujoco>')
    make(path, part=(1, 2))
    edited(path.parent / "room.xml", 'size="0.1 3 1"', 'size="0.1 2 1"')
    edited(path, "  - {name: room, file: room.xml}\n", "")
    make(path, part=(2, 2))
    assert rigcast.open_dataset(path.parent / "out").verify() == ["lone: its model changed while the data set was made"]


@pytest.mark.parametrize("text", [None, "{", "[]", '{"format": "rigcast dataset 9"}'])
def test_a_folder_without_a_data_set_is_refused(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "dataset.json").write_text(text)
    with pytest.raises(InputError, match=r"dataset\.json: not the manifest of a data set"):
        rigcast.open_dataset(tmp_path)


def test_an_open_data_set_goes_to_other_processes(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder)
    first = frames[0]["range"]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(frames))[0]["range"], first)


_T = TypeVar("_T")


class _FakeDataset(Generic[_T]):
    """What torch.utils.data.Dataset is: a base class without anything that is used here."""


def test_torch_gets_tensors(whole_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch: Any = ModuleType("torch")
    torch.utils = ModuleType("torch.utils")
    torch.utils.data = ModuleType("torch.utils.data")
    torch.utils.data.Dataset = _FakeDataset
    torch.from_numpy = lambda array: ("tensor", array)
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.delitem(sys.modules, "rigcast.dataset.in_torch", raising=False)
    top = rigcast.open_dataset(whole_folder).of("top")
    frames: Any = top.torch("range", "pose")
    assert issubclass(type(frames), _FakeDataset)
    assert len(frames) == len(top)
    for name, (kind, array) in frames[3].items():
        assert kind == "tensor"
        assert array.flags.writeable
        np.testing.assert_array_equal(array, top[3][name])
    monkeypatch.delitem(sys.modules, "rigcast.dataset.in_torch", raising=False)


def test_without_torch_it_is_said_what_to_install(whole_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "rigcast.dataset.in_torch", raising=False)
    with pytest.raises(InputError, match=r"Dataset\.torch needs torch"):
        rigcast.open_dataset(whole_folder).torch("range")
