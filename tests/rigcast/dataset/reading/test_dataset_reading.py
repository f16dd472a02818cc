"""Frames of a data set are read by their number as they were written, or an error says what is wrong."""

import pickle
import shutil
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_datasets import edited, make

import rigcast
from rigcast.dataset.reading import Dataset
from rigcast.export.fields import field_names
from rigcast.sensors.errors import InputError


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
    assert front["depth_scale"] == 0.001
    assert top["pose"].shape == (4, 4)
    assert float(top["time"]) == top.time
    elsewhere = {"flex_id", "skin_id", "prop_id"}  # fields of other scenes
    common = {"time", "pose", "class_id"}
    assert set(top) == {*common, *field_names("lidar")} - elsewhere
    assert set(front) == {*common, "intrinsics", "depth_scale", *field_names("depth_camera")} - elsewhere
    assert "intrinsics" not in top
    with pytest.raises(KeyError, match=r"'top' at 0.02 s in episode 0 .* has no 'rnage', .*did you mean 'range'"):
        top["rnage"]


@pytest.mark.parametrize("form", ["npz", "zarr"])
def test_only_the_fields_that_were_chosen_are_there(path: Path, form: str) -> None:
    path.write_text(path.read_text() + f"output: {{format: {form}, fields: {{top: [range, skin_id], front: []}}}}\n")
    make(path)
    frames = rigcast.open_dataset(path.parent / "out", verify=True)
    assert set(frames.of("top")[0]) == {"time", "pose", "range"}  # there are no skins
    assert set(frames.of("front")[0]) == {"time", "pose", "intrinsics", "depth_scale"}
    assert frames.manifest["statistics"]["front"]["hits"] > 0


def test_zarr_holds_the_same_as_npz(path: Path, whole_folder: Path) -> None:
    path.write_text(path.read_text() + "output: {format: zarr}\n")
    make(path)
    packed, plain = rigcast.open_dataset(path.parent / "out", verify=True), rigcast.open_dataset(whole_folder)
    assert len(packed) == len(plain)
    for one, other in zip(packed, plain, strict=True):
        assert (one.sensor, one.time, one.seed) == (other.sensor, other.time, other.seed)
        assert list(one) == list(other) == sorted(one)
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.parametrize("form", ["npz", "zarr"])
def test_a_frame_knows_the_classes_of_what_it_sees(path: Path, form: str) -> None:
    classes = "classes: {ground: [floor], thing: [table, sign]}\n"
    (path.parent / "rig.yaml").write_text((path.parent / "rig.yaml").read_text() + classes)
    path.write_text(path.read_text() + f"output: {{format: {form}, fields: {{top: [range, geom_id]}}}}\n")
    make(path)
    seen = set()
    for frame in rigcast.open_dataset(path.parent / "out").of("top"):
        names: Any = frame.names
        assert names["class_name"] == ["", "ground", "thing"]
        assert frame["class_id"].dtype == np.int32
        for geom, label in zip(frame["geom_id"].ravel(), frame["class_id"].ravel(), strict=True):
            body = names["body_name"][names["geom_body"][geom]]
            of_body = 2 if body in ("table", "sign") else 0
            assert label == (0 if geom < 0 else 1 if names["geom_name"][geom] == "floor" else of_body)
            seen.add(int(label))
    assert seen == {0, 1, 2}


def test_without_geom_ids_there_are_no_classes(path: Path) -> None:
    path.write_text(path.read_text() + "output: {fields: {top: [range]}}\n")
    make(path)
    frame = rigcast.open_dataset(path.parent / "out").of("top")[0]
    assert "class_id" not in frame
    with pytest.raises(KeyError, match="has no 'class_id', expected one of pose, range, time"):
        frame["class_id"]


def test_scenes_and_episodes_are_selected_alone_and_together(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder)

    def places(some: Dataset) -> set[tuple[str, int, str]]:
        return {(frame.scene, frame.episode, frame.sensor) for frame in some}

    rooms, first = frames.of(scenes=["room"]), frames.of("top", episodes=range(1))
    assert places(rooms) == {("room", k, name) for k in (0, 1) for name in ("top", "front")}
    assert places(first) == {(scene, 0, "top") for scene in ("room", "made")}
    assert places(rooms.of("top").of(episodes=np.array([1, 7]))) == {("room", 1, "top")}
    assert len(frames.of(episodes=[])) == 0
    assert len(frames) == len(frames.of(episodes=[0])) + len(frames.of(episodes=[1]))
    last = frames.of("top", scenes=["room"], episodes=[1])[-1]
    np.testing.assert_array_equal(rooms.of("top")[-1]["range"], last["range"])


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"scenes": ["rom"]}, r"dataset\.json: no scene 'rom', expected one of .*; did you mean 'room'"),
        ({"scenes": "room"}, r"Dataset\.of: scenes: got 'room', expected a list of names, such as \['room'\]"),
        ({"scenes": [3]}, r"Dataset\.of: name of a scene: got int, expected str"),
        ({"episodes": 3}, r"Dataset\.of: episodes: got 3, expected their numbers, such as range\(80\) or \[0, 2\]"),
        ({"episodes": "3"}, r"Dataset\.of: episodes: got '3', expected their numbers"),
        ({"episodes": [0.5]}, r"Dataset\.of: episodes: got \[0\.5\], expected their numbers"),
    ],
)
def test_a_wrong_selection_is_refused(whole_folder: Path, chosen: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        rigcast.open_dataset(whole_folder).of(**chosen)


def test_a_sensor_that_is_not_there_is_named(whole_folder: Path) -> None:
    with pytest.raises(InputError, match="no sensor 'tpo', expected one of top, front; did you mean 'top'"):
        rigcast.open_dataset(whole_folder).of("tpo")
    with pytest.raises(InputError, match=r"Dataset\.of: name of a sensor: got list, expected str"):
        rigcast.open_dataset(whole_folder).of(["top"])  # type: ignore[arg-type]


def test_a_sensor_for_a_number_is_told_how_to_choose_one(whole_folder: Path) -> None:
    with pytest.raises(InputError, match=r"got 'top', expected the number of a frame; of\('top'\)\[0\] is the first"):
        rigcast.open_dataset(whole_folder)["top"]


def test_a_data_set_in_a_terminal_says_what_it_is(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder)
    counts = [f"{len(frames.of(name))} frames of {name!r}" for name in ("top", "front")]
    assert repr(frames) in {f"<data set of {', '.join(order)}>" for order in (counts, counts[::-1])}


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


@pytest.mark.parametrize("form", ["npz", "zarr"])
@pytest.mark.parametrize("kept", [0, 200])
def test_a_file_that_is_cut_off_is_named(path: Path, form: str, kept: int) -> None:
    path.write_text(path.read_text() + f"output: {{format: {form}}}\n")
    make(path)
    (file,) = (path.parent / "out/room/000001").glob("frames.*")
    file.write_bytes(file.read_bytes()[:kept])
    frames = rigcast.open_dataset(path.parent / "out")
    with pytest.raises(InputError, match=rf"^{file}: cannot be read: .*; verify\(\) names all such files"):
        [frame["range"] for frame in frames]


@pytest.mark.parametrize("form", ["npz", "zarr"])
def test_an_array_that_was_damaged_is_not_given_out(path: Path, form: str) -> None:
    path.write_text(path.read_text() + f"output: {{format: {form}, fields: {{top: [range]}}}}\n")
    make(path)
    frames = rigcast.open_dataset(path.parent / "out").of("top")
    (file,) = (path.parent / "out/room/000001").glob("frames.*")
    with zipfile.ZipFile(file) as archive:
        (part, *_) = [info for info in archive.infolist() if "top" in info.filename and "range" in info.filename]
    held = bytearray(file.read_bytes())
    held[part.header_offset + 30 + len(part.filename) + part.file_size - 1] ^= 1
    file.write_bytes(held)
    with pytest.raises(InputError, match=r"in episode 1 of 'room'>: range: cannot be read: Bad CRC-32"):
        [frame["range"] for frame in frames]


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


def test_a_file_in_place_of_the_folder_is_told(whole_folder: Path) -> None:
    with pytest.raises(InputError, match=r"dataset\.json: a file, expected the folder of a data set"):
        rigcast.open_dataset(whole_folder / "dataset.json")
    with pytest.raises(InputError, match="open_dataset: path: got int, expected str or Path"):
        rigcast.open_dataset(3)  # type: ignore[arg-type]


def test_an_open_data_set_goes_to_other_processes(whole_folder: Path) -> None:
    frames = rigcast.open_dataset(whole_folder)
    first = frames[0]["range"]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(frames))[0]["range"], first)


@pytest.mark.parametrize("workers", [0, pytest.param(1, marks=pytest.mark.long)])
def test_torch_loads_batches(whole_folder: Path, workers: int) -> None:
    data: Any = pytest.importorskip("torch.utils.data")
    top = rigcast.open_dataset(whole_folder).of("top")
    frames: Any = top.torch("range", "pose", "geom_id")
    assert isinstance(frames, data.Dataset)
    context = "spawn" if workers else None  # a fork of a process with Warp's threads may hang
    batches = list(data.DataLoader(frames, batch_size=5, num_workers=workers, multiprocessing_context=context))
    assert [len(batch["range"]) for batch in batches] == [5, 5, 5, 5]
    for k, frame in enumerate(top):
        for name in ("range", "pose", "geom_id"):
            got = batches[k // 5][name][k % 5].numpy()
            assert got.dtype == frame[name].dtype
            np.testing.assert_array_equal(got, frame[name], err_msg=f"{name} of frame {k}")


def test_a_field_that_torch_cannot_have_is_named(whole_folder: Path) -> None:
    with pytest.raises(InputError, match=r"has no 'rnage', expected one of .*; did you mean 'range'"):
        rigcast.open_dataset(whole_folder).of("top").torch("rnage")


def test_without_torch_it_is_said_what_to_install(whole_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "rigcast.dataset.reading.in_torch", raising=False)
    with pytest.raises(InputError, match=r"Dataset\.torch needs torch"):
        rigcast.open_dataset(whole_folder).torch("range")
