"""Rigs made of several files, of repeated sensors, and of values set from the shell."""

import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from rigcast.rig_file import open_rig, read_rig
from rigcast.schema import rig_schema
from rigcast.sensors.errors import InputError

MODEL = """
<mujoco>
  <worldbody>
    <body name="torso">
      <geom size="0.1"/>
      <site name="tof_left"/> <site name="tof_right"/>
    </body>
  </worldbody>
</mujoco>
"""
BASE = """\
model: robot.xml
seed: 3
sensors:
  - name: top
    type: lidar
    preset: velodyne_vlp16
    mount: {body: torso, pos: [0, 0, 1]}
  - {name: feet, type: height_scan, mount: {body: torso}, size: [1, 1], spacing: 0.5}
"""
TOF = """\
model: base/robot.xml
sensors:
  - repeat: {side: [left, right], yaw: [90, -90], columns: [4, 8]}
    name: tof_$side
    type: lidar
    mount: {site: tof_$side, euler_deg: [0, 0, $yaw]}
    elevation_deg: [0]
    columns: $columns
    rate_hz: 10
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "base").mkdir()
    (tmp_path / "base" / "robot.xml").write_text(MODEL)
    (tmp_path / "base" / "base.yaml").write_text(BASE)
    return tmp_path


def write(folder: Path, text: str, name: str = "rig.yaml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def error_of(path: Path, *overrides: str) -> str:
    with pytest.raises(InputError) as caught:
        open_rig(path, overrides=overrides)
    return str(caught.value)


def test_a_file_is_laid_over_what_it_extends(folder: Path) -> None:
    path = write(
        folder,
        """\
extends: base/base.yaml
seed: 4
sensors:
  - {name: more, type: height_scan, mount: {}, size: [2, 2], spacing: 1}
  - {name: top, rate_hz: 5, mount: {pos: [0, 0, 2]}}
""",
    )
    config, model = open_rig(path)
    top = config.sensors[0]
    assert [sensor.name for sensor in config.sensors] == ["top", "feet", "more"]
    assert (config.seed, top.rate_hz, top.preset) == (4, 5, "velodyne_vlp16")
    assert (top.mount.body, top.mount.pos) == ("torso", (0, 0, 2))
    assert config.model == folder / "base" / "robot.xml"
    assert config.files == (path, folder / "base" / "base.yaml")
    assert model.nsite == 2


def test_later_files_lie_on_top(folder: Path) -> None:
    write(folder, "seed: 5\nkeyframe: one\n", "a.yaml")
    write(folder, "seed: 6\n", "b.yaml")
    config = read_rig(write(folder, "extends: [base/base.yaml, a.yaml, b.yaml]\n"))
    assert (config.seed, config.keyframe, len(config.sensors)) == (6, "one", 2)


def test_null_takes_back_what_the_base_says(folder: Path) -> None:
    path = write(folder, "extends: base/base.yaml\nsensors: [{name: top, mount: {body: null, site: tof_left}}]\n")
    assert open_rig(path)[0].sensors[0].mount.parent == "site"


def test_a_prop_is_found_beside_the_file_that_names_it(folder: Path) -> None:
    vertices = "".join(f"v {x}\n" for x in ("0 0 0", "1 0 0", "0 1 0"))
    (folder / "base" / "tile.obj").write_text(vertices + "f 1 2 3\n")
    write(folder / "base", BASE + "props: [{name: tile, file: tile.obj}]\n", "props.yaml")
    more = "props: [{name: tile, scale: 2}]\nsurfaces: [{prop: tile, mirror: 0.5}]\n"
    config, _ = open_rig(write(folder, f"extends: base/props.yaml\n{more}"))
    assert (config.props[0].file, config.props[0].scale) == (folder / "base" / "tile.obj", 2.0)
    assert (config.surfaces[0].prop, config.surfaces[0].mirror) == ("tile", 0.5)


def test_a_sensor_is_repeated_for_each_row(folder: Path) -> None:
    sensors = open_rig(write(folder, TOF))[0].sensors
    assert [(s.name, s.mount.site) for s in sensors] == [("tof_left", "tof_left"), ("tof_right", "tof_right")]
    assert [s.mount.euler_deg for s in sensors] == [(0, 0, 90), (0, 0, -90)]
    assert [getattr(s, "columns", None) for s in sensors] == [4, 8]


def test_lists_and_mappings_are_repeated_where_they_stand_alone(folder: Path) -> None:
    text = TOF.replace("columns: [4, 8]}", "columns: [4, 8], pos: [[1, 0, 0], [0, 1, 0]], mine: [{static: false}, {}]}")
    text = text.replace("euler_deg", "pos: $pos, euler_deg").replace("rate_hz: 10", "filter: $mine")
    sensors = open_rig(write(folder, text))[0].sensors
    assert [s.mount.pos for s in sensors] == [(1, 0, 0), (0, 1, 0)]
    assert [s.filter.static for s in sensors] == [False, True]
    jsonschema.validate(YAML(typ="safe", pure=True).load(text), rig_schema())


def test_copies_are_overridden_by_name(folder: Path) -> None:
    write(folder, TOF, "tof.yaml")
    path = write(folder, "extends: tof.yaml\nsensors: [{name: tof_right, rate_hz: 20}]\n")
    assert [sensor.rate_hz for sensor in open_rig(path)[0].sensors] == [10, 20]


def test_dollars_are_left_alone_where_nothing_is_repeated(folder: Path) -> None:
    assert "no body 'a$b'" in error_of(write(folder, BASE.replace("torso", "a$b"), "base/rig.yaml"))


@pytest.mark.parametrize(
    ("override", "where", "expected"),
    [
        ("seed=9", "config.seed", 9),
        ("sensors.top.rate_hz=5", "config.sensors[0].rate_hz", 5),
        ("sensors.*.rate_hz=5", "config.sensors[1].rate_hz", 5),
        ("sensors[1].spacing=0.25", "config.sensors[1].spacing", 0.25),
        ("sensors.1.spacing=0.25", "config.sensors[1].spacing", 0.25),
        ("sensors.top.mount.pos[2]=4", "config.sensors[0].mount.pos", (0, 0, 4)),
        ("sensors.top.filter.exclude_bodies=[torso]", "config.sensors[0].filter.exclude_bodies", ("torso",)),
        ("sensors.top.filter={exclude_bodies: [torso]}", "config.sensors[0].filter.exclude_bodies", ("torso",)),
        ("sensors.top.max_range=.inf", "config.sensors[0].max_range", float("inf")),
        ("sensors.top.firing_time_us=null", "config.sensors[0].firing_time_us", None),
    ],
)
def test_a_value_is_set(folder: Path, override: str, where: str, expected: Any) -> None:
    config, _ = open_rig(folder / "base" / "base.yaml", overrides=[override])
    assert eval(where, {"config": config}) == expected


def test_a_model_that_is_set_is_found_from_here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    write(folder, MODEL.replace("torso", "trunk"), "other.xml")
    overrides = ["model=other.xml", "sensors.*.mount={}"]
    assert open_rig(folder / "base" / "base.yaml", overrides=overrides)[1].body("trunk").id == 1


# (what is set, with § before what is at fault, and what is said about it)
SET_FAULTS = [
    ("sensors.top.rate_hz=§fast", r"sensors\[0\].rate_hz: must be a number, got 'fast'"),
    ("sensors.top.§rat_hz=3", r"sensors\[0\].rat_hz: unknown key .*did you mean 'rate_hz'\?"),
    ("sensors.§tip.rate_hz=3", r"no item named 'tip', expected one of top, feet; did you mean 'top'\?"),
    ("§top.rate_hz=3", r"unknown key 'top'; did you mean 'sensors\.top'\?"),
    ("§rate_hz=3", r"unknown key 'rate_hz' of a rig, which its sensors have: 'sensors\.\*\.rate_hz'"),
    ("sensors[§7].rate_hz=3", "no item 7, expected 0 to 1"),
    ("sensors.top.mount.pos[§3]=1", "no item 3, expected 0 to 2"),
    ("seed.§x=3", "seed: must be an integer"),
    ("sensors.top.mount.body=§legg", r"no body 'legg' in the model"),
    ("seed=[1,§", "not valid YAML"),
    ("seed=§!!int 3", "got the tag !!int, expected a plain value"),
]


@pytest.mark.parametrize(("override", "message"), SET_FAULTS)
def test_a_wrong_value_is_shown_in_what_was_typed(folder: Path, override: str, message: str) -> None:
    typed, column = override.replace("§", ""), override.index("§")
    lines = error_of(folder / "base" / "base.yaml", "seed=1", typed).splitlines()
    assert lines[0].startswith(f"--set:2:{column + 1}: "), lines
    assert re.search(message, lines[0]), lines
    assert lines[1] == f"    {typed}"
    assert lines[2] == f"    {' ' * (lines[2].index('^') - 4)}^"


@pytest.mark.parametrize("override", ["seed", "=3", "seed=", "se ed=3", "a..b=3", ".a=3"])
def test_what_is_no_override_is_refused(folder: Path, override: str) -> None:
    message = error_of(folder / "base" / "base.yaml", override)
    assert message == f"--set: got {override!r}, expected KEY=VALUE, such as sensors.top.rate_hz=5"


def test_files_are_not_extended_by_an_override(folder: Path) -> None:
    message = error_of(folder / "base" / "base.yaml", "extends=other.yaml")
    assert message.startswith("--set: got 'extends=other.yaml': values are set after files have been merged")


@pytest.mark.parametrize("overrides", ["seed=3", {"seed": 3}])
def test_overrides_that_are_no_list_are_refused(folder: Path, overrides: Any) -> None:
    with pytest.raises(InputError, match=r"^overrides: got .*seed.*, expected a list such as \['sensors\.top"):
        open_rig(folder / "base" / "base.yaml", overrides=overrides)


# (the file, with § before what is at fault, and what is said about it)
FAULTS = [
    ("extends: §no.yaml\n", "extends: .*no.yaml is not a file"),
    ("extends: §ouster_os1_64\n", "extends: .*is not a file; a sensor has a device as `preset: ouster_os1_64`"),
    ("extends: §rig.yaml\n", "extends: .*rig.yaml -> .*rig.yaml is a circle"),
    ("extends: §3\n" + BASE.replace("robot", "base/robot"), "extends: must be the name of a file, or a list of them"),
    ("extends: §[base/base.yaml, 3]\n", "extends: must be the name of a file, or a list of them"),
    ("extends: base/base.yaml\nsensors: [{name: top, §rat: 3}]\n", r"sensors\[0\].rat: unknown key"),
    (
        "extends: base/base.yaml\nsensors: [{name: top}, {name: §top, type: height_scan, mount: {}, size: [1, 1], "
        "spacing: 1}]\n",
        r"'top' is the name of sensors.\d. already",
    ),
    ("extends: base/base.yaml\nsensors: §3\n", "sensors: must be a list"),
    ("extends: base/base.yaml\nsurfaces: [{prop: §tile, mirror: 0.5}]\n", r"surfaces\[0\].prop: no prop 'tile'"),
    ("extends: base/base.yaml\nsensors: [§{type: lidar}]\n", r"sensors\[0\].(name|mount): required"),
    (TOF.replace("[0, 0, $yaw]", "[0, 0, §$yav]"), "no .yav in repeat, expected one of side, yaw, .*'yaw'"),
    (TOF.replace("name: tof_$side", "name: §tof_$"), "a . must be followed by a name of repeat"),
    (TOF.replace("{side", "§{side").replace("[90", "[90, 0"), "equal length, got 2 of side, 3 of yaw, 2 of columns"),
    (
        TOF.replace("4, 8", "4, {a: 1}").replace("columns: $", "columns: §$"),
        r"columns: must be an integer, got \{'a': 1\}",
    ),
    (TOF.replace("tof_$side,", "§tof_$side$columns,").replace("4, 8", "[4], 8"), "list or mapping, expected it alone"),
    (TOF.replace("{side: [left, right], yaw: [90, -90], columns: [4, 8]}", "§3"), "repeat: must be names with lists"),
    (TOF.replace("{side: [left, right], yaw: [90, -90], columns: [4, 8]}", "§{}"), "repeat: must be names with lists"),
    (TOF.replace("name: tof_$side", "name: §tof"), "'tof' is the name of sensors.0. already"),
    (TOF.replace("columns: $columns", "columns: §$side"), r"columns: must be an integer, got 'left'"),
    (TOF.replace("site: tof_$side", "site: §tof$side"), "no site 'tofleft' in the model"),
]


@pytest.mark.parametrize(("text", "message"), FAULTS)
def test_a_fault_is_shown_in_the_file_that_has_it(folder: Path, text: str, message: str) -> None:
    before = text.partition("§")[0].split("\n")
    path = write(folder, text.replace("§", ""))
    first = error_of(path).splitlines()[0]
    assert first.startswith(f"{path}:{len(before)}:{len(before[-1]) + 1}: "), first
    assert re.search(message, first), first


def test_a_circle_is_shown_where_it_closes(folder: Path) -> None:
    path = write(folder, "extends: [base/base.yaml, b.yaml]\n", "a.yaml")
    write(folder, "extends: ./base/../a.yaml\n", "b.yaml")
    first = error_of(path).splitlines()[0]
    circle = " -> ".join(str(folder / name) for name in ("a.yaml", "b.yaml", "base/../a.yaml"))
    assert first == f"{folder / 'b.yaml'}:1:10: extends: {circle} is a circle"


def test_faults_of_several_files_are_told_at_once(folder: Path) -> None:
    write(folder / "base", BASE.replace("spacing", "spcing"), "base.yaml")
    path = write(folder, "extends: base/base.yaml\nsed: 3\n")
    places = re.findall(r"^(\S+yaml|--set):(\d+:\d+)", error_of(path, "keyframe=2"), re.MULTILINE)
    base = str(folder / "base" / "base.yaml")
    assert places == [(str(path), "2:1"), (base, "8:5"), (base, "8:73"), ("--set", "1:10")]


@pytest.mark.parametrize(
    ("rows", "body"),
    [(["0"] * 5000, ["1"] * 5000), ([f"[{', '.join(['1'] * 100)}]"] * 10, ["$k"] * 200)],
    ids=["of the sensor's own values", "of a row's"],
)
def test_a_bomb_of_repeats_does_not_go_off(folder: Path, rows: list[str], body: list[str]) -> None:
    text = f"sensors:\n  - {{repeat: {{k: [{', '.join(rows)}]}}, name: a, elevation_deg: [{', '.join(body)}]}}\n"
    assert "repeat: stands for more than 100000 values" in error_of(write(folder, text))


def test_a_bomb_of_files_does_not_go_off(folder: Path) -> None:
    for k in range(12):
        write(folder, f"extends: [{k + 1}.yaml, {k + 1}.yaml, {k + 1}.yaml]\n", f"{k}.yaml")
    write(folder, "seed: 3\n", "12.yaml")
    assert "more than 100 files" in error_of(folder / "0.yaml")
