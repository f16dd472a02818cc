"""The description of a data set: its keys, and where mistakes are shown."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from small_datasets import controlled_by, edited

from rigcast.dataset.description.config import read_dataset
from rigcast.rig_file import load_rig
from rigcast.sensors.errors import InputError


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ("seed: 3", "sed: 3", "set.yaml:9:1", "unknown key 'sed'"),
        ("rig: rig.yaml", "rig: none.yaml", "set.yaml:1:6", "none.yaml is not a file"),
        ("file: room.xml", "file: none.xml", "set.yaml:3:24", "none.xml is not a file"),
        ("{name: made,", "{name: room,", "set.yaml:3:12", "'room' is the name of something else too"),
        ("{name: made,", f"{{name: {65 * 'a'},", "set.yaml:4:12", "must have at most 64 characters, got 'aaa"),
        ("{name: made,", "{name: failed,", "set.yaml:4:12", "'failed' is the name of something else too"),
        ("{name: made,", "{name: made, file: room.xml,", "set.yaml:4:5", "give one of file and python, got both"),
        (":room", ":rom", "set.yaml:4:26", "has no attribute 'rom'"),
        (":push", ":number", "set.yaml:5:74", "got int, expected a function"),
        ("duration: 0.1", "duration: 0", "set.yaml:5:32", "must be greater than 0"),
        ("type: python, function", "type: pythn, function", "set.yaml:5:56", "unknown type 'pythn'"),
        ("[0, 0.05]", "[0.05, 0]", "set.yaml:8:8", "sensors.top.noise.range_std: must be [low, high], got [0.05, 0.0]"),
        ("[0, 0.05]", "[0, 0.05, 0.1]", "set.yaml:8:8", "range_std: must be [low, high], got [0.0, 0.05, 0.1]"),
        ("[0, 0.05]", "[0, .inf]", "set.yaml:8:42", "must be a finite number"),
        ("range_std: [0", "range_std: [-1", "set.yaml:8:8", "with the lowest values: --set:1:"),
        ("dropout: [0, 0.5]", "drop: [0, 0.5]", "set.yaml:8:8", "did you mean 'dropout'?"),
        ("seed: 3", "output: {fields: {tpo: [range]}}", "set.yaml:9:19", "no sensor 'tpo', expected one of top, front"),
        (
            "seed: 3",
            "output: {fields: {top: [range, dept]}}",
            "set.yaml:9:32",
            "no field 'dept' of a lidar, expected one",
        ),
        ("seed: 3", "output: {fields: {top: [depth]}}", "set.yaml:9:25", "no field 'depth' of a lidar, expected one"),
        ("seed: 3", "output: {fields: {top: [class_id]}}", "set.yaml:9:25", "did you mean 'geom_id'?"),
        ("sign: {pos", "sing: {pos", "set.yaml:7:64", "can be moved in the scene 'room', expected one of table, sign"),
        ("sign: {pos", "world: {pos", "set.yaml:7:64", "no body 'world' that can be moved"),
        ("count: 2", "count: 0", "set.yaml:5:19", "must be greater than or equal to 1"),
        ("count: 2", "count: 100000001", "set.yaml:5:19", "must be less than or equal to 100000000"),
    ],
)
def test_a_mistake_is_shown_where_it_is(path: Path, old: str, new: str, place: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read_dataset(edited(path, old, new))
    assert str(caught.value).startswith(str(path.parent / place)), str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("sensor", "fields"), [("top", "range, intensity, ring, column"), ("front", "depth, depth_16bit, intensity, stamp")]
)
def test_fields_that_only_its_kind_of_sensor_has_can_be_chosen(path: Path, sensor: str, fields: str) -> None:
    config = read_dataset(edited(path, "seed: 3", f"output: {{fields: {{{sensor}: [{fields}]}}}}"))
    assert config.file.output.fields == {sensor: fields.split(", ")}


def test_a_rig_in_place_of_a_data_set_is_told_apart(path: Path) -> None:
    with pytest.raises(InputError, match=r"rig\.yaml:1:1: a rig, expected a data set; `rigcast validate .*` shows it"):
        read_dataset(path.parent / "rig.yaml")
    with pytest.raises(InputError, match=r"set\.yaml:1:1: a data set, expected a rig; `rigcast dataset .*` makes it"):
        load_rig(path)


@pytest.mark.parametrize("scene", ["room.mjb", "broken.xml", "broken.mjb"])
def test_bodies_to_be_moved_are_looked_for_in_every_file_that_can_be_read(path: Path, scene: str) -> None:
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_path(str(path.parent / "room.xml")), str(path.parent / "room.mjb"))
    (path.parent / "broken.xml").write_text("<mujoco>")
    (path.parent / "broken.mjb").write_text("<mujoco>")
    edited(path, "file: room.xml", f"file: {scene}")
    read_dataset(path)
    edited(path, "sign: {pos", "sing: {pos")
    if scene == "room.mjb":
        with pytest.raises(InputError, match="no body 'sing'"):
            read_dataset(path)
    else:
        read_dataset(path)  # its episodes fail, and say why


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "body: cart, pos: [0, 0, 0.5]",
            "body: carts",
            "no body 'carts' there, on which 'top' of the rig is mounted; e",
        ),
        (
            "body: cart, pos: [0.3, 0, 0]",
            "site: eye",
            "no site 'eye' there, on which 'front' of the rig is mounted; and none",
        ),
        (
            "body: cart, pos: [0.3, 0, 0]",
            "camera: eye",
            "no camera 'eye' there, on which 'front' of the rig is mounted",
        ),
        ("columns: 36", "columns: 36\n    filter: {exclude_bodies: [art]}", "no body 'art' there, which the filter of"),
    ],
)
@pytest.mark.parametrize("scene", ["room.xml", "room.mjb"])
def test_what_a_scene_lacks_of_the_rig_is_told_before_its_episodes(
    path: Path, old: str, new: str, message: str, scene: str
) -> None:
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_path(str(path.parent / "room.xml")), str(path.parent / "room.mjb"))
    edited(path, "file: room.xml", f"file: {scene}")
    edited(path.parent / "rig.yaml", old, new)
    with pytest.raises(InputError) as caught:
        read_dataset(path)
    assert str(caught.value).startswith(f"{path}:3:24: scenes[0].file: {message}")


def test_mistakes_are_shown_all_at_once(path: Path) -> None:
    edited(path, "file: room.xml", "file: none.xml")
    edited(path, ":room", ":rom")
    with pytest.raises(InputError) as caught:
        read_dataset(path)
    assert str(caught.value).count("set.yaml:") == 2


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (None, "No such file"),
        (np.zeros(8), "got an array of shape (8,)"),
        (np.full((9, 8), np.nan), "finite numbers"),
        (np.zeros((5, 8)), "got 0.1 s, but the motion lasts 0.08 s"),
    ],
)
def test_a_recorded_motion_must_be_one(path: Path, rows: np.ndarray | None, message: str) -> None:
    if rows is not None:
        np.save(path.parent / "walk.npy", rows)
    controlled_by(path, "type: recorded, file: walk.npy, rate_hz: 50")
    with pytest.raises(InputError) as caught:
        read_dataset(path)
    assert message in str(caught.value)


def test_values_are_set_from_the_shell(path: Path) -> None:
    config = read_dataset(path, ["episodes.count=5", "scenes.made.name=other"])
    assert [unit.name for unit in config.units()] == [f"{name}/{k:06d}" for name in ("room", "other") for k in range(5)]


def test_the_seed_of_an_episode_depends_on_no_other(path: Path) -> None:
    seeds = {unit.name: unit.seed for unit in read_dataset(path).units()}
    more = {unit.name: unit.seed for unit in read_dataset(path, ["episodes.count=9"]).units()}
    assert len(set(more.values())) == 18
    assert {name: more[name] for name in seeds} == seeds
    others = {unit.seed for unit in read_dataset(path, ["seed=4"]).units()}
    assert others.isdisjoint(more.values())
