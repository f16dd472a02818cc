"""A rig file becomes a rig, or one error that shows every mistake where it is."""

import re
from pathlib import Path
from typing import Any

import mujoco
import pytest

from rigcast.rig_file import load_rig, open_rig, read_rig
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount

MODEL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="torso" pos="0 0 1">
      <freejoint/>
      <geom size="0.1"/>
      <site name="mast"/>
      <camera name="head" resolution="64 48"/>
      <camera name="bare"/>
    </body>
  </worldbody>
  <keyframe><key name="home" qpos="0 0 1 1 0 0 0"/></keyframe>
</mujoco>
"""

GOOD = """\
# A comment, and an anchor that is used again.
model: models/robot.xml
seed: 7
keyframe: home
sensors:
  - name: top
    type: lidar
    preset: velodyne_vlp16
    mount: {body: torso, pos: [0, 0, 0.3], euler_deg: [0, 0, 90]}
    rate_hz: 10
    max_range: 5e1
    filter: &own {exclude_bodies: [torso], exclude_subtree: true}
  - name: front
    type: depth_camera
    mount: {camera: head}
    filter: *own
  - {name: feet, type: height_scan, mount: {site: mast}, size: [1.6, 1.0], spacing: 0.1, max_range: .inf}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "robot.xml").write_text(MODEL)
    return tmp_path


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def error_of(path: Path, model: Path | None = None) -> str:
    with pytest.raises(InputError) as caught:
        load_rig(path, model)
    return str(caught.value)


def test_yaml_says_what_python_says(folder: Path) -> None:
    config = read_rig(write(folder, GOOD))
    own = Filter(exclude_bodies=["torso"], exclude_subtree=True)
    torso = Mount(body="torso", pos=(0, 0, 0.3), euler_deg=(0, 0, 90))
    assert config.model == folder / "models" / "robot.xml"
    assert (config.seed, config.keyframe) == (7, "home")
    assert config.sensors == (
        Lidar(name="top", preset="velodyne_vlp16", mount=torso, rate_hz=10, max_range=50, filter=own),
        DepthCamera(name="front", mount=Mount(camera="head"), filter=own),
        HeightScan(name="feet", mount=Mount(site="mast"), size=(1.6, 1.0), spacing=0.1),
    )


def test_only_sensors_are_required(folder: Path) -> None:
    config = read_rig(write(folder, "sensors: [{name: a, type: lidar, preset: velodyne_vlp16, mount: {}}]"))
    assert (config.model, config.seed, config.keyframe) == (None, 0, None)


def test_the_model_is_found_beside_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(folder, GOOD)
    monkeypatch.chdir(folder.parent)
    _, model = open_rig(Path(folder.name) / "rig.yaml")
    assert model.body("torso").id == 1


@pytest.mark.parametrize("kind", ["model", "xml", "mjb"])
def test_a_model_given_takes_the_place_of_the_files(folder: Path, kind: str) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.replace('size="0.1"', 'size="0.25"'))
    binary, xml = folder / "other.mjb", folder / "other.xml"
    mujoco.mj_saveModel(model, str(binary))
    xml.write_text(MODEL.replace('size="0.1"', 'size="0.25"'))
    given = {"model": model, "xml": str(xml), "mjb": binary}[kind]
    _, opened = open_rig(write(folder, GOOD.replace("models/robot.xml", "missing.xml")), given)
    assert opened.geom_size[1, 0] == 0.25


@pytest.mark.parametrize("text", ["\ufeff" + GOOD, GOOD.replace("\n", "\r\n"), "%YAML 1.2\n---\n" + GOOD])
def test_ways_to_write_a_file(folder: Path, text: str) -> None:
    path = folder / "rig.yaml"
    path.write_bytes(text.encode("utf-8"))
    assert [sensor.name for sensor in read_rig(path).sensors] == ["top", "front", "feet"]


HEAD = "model: models/robot.xml\n"
LIDAR = "type: lidar, preset: velodyne_vlp16"
ONE = HEAD + "sensors:\n  - {name: a, " + LIDAR + ", mount: {body: torso}"
CAMERA = HEAD + "sensors:\n  - §{name: a, type: depth_camera, mount: {camera: bare}}"

# (what is in the file, with § before what is at fault, and what is said about it)
FAULTS = [
    # the file as YAML
    ("", "the file is empty"),
    ("# nothing\n", "the file is empty"),
    ("a: [1, 2\nb§: 3\n", r"not valid YAML: expected ',' or '\]', but got ':' while .*, which begins at 1:4"),
    ("a: §'x\n", "not valid YAML: the text that begins here has no closing quotation mark"),
    ("a: 1\n§---\nb: 2\n", "not valid YAML: expected a single document in the stream, but found another document"),
    ("a:\n§\tb: 1\n", "not valid YAML: got a tab, expected spaces"),
    ("a:\n    b: 1\n  §c: 2\n", "not valid YAML: not indented like the rest of its .*, which begins at 1:1"),
    ("a: 1\n§b:2\nc: 3\n", "not valid YAML: expected a key and its value, with a colon and a space between them"),
    ("a:\n  b: 1\n §\u00a0c: 1\n", r"not valid YAML: got the character U\+00A0, expected spaces as indentation"),
    ("a: §*x\n", "not valid YAML: found undefined alias 'x'"),
    ("a: 1\nb: §\x01\n", r"not valid YAML: got the character U\+0001, expected printable text"),
    ("seed: 1\n§seed: 2\n", "seed: duplicate key 'seed', which stands in line 1 already"),
    (ONE + ", min_range: 1, §min_range: 2}", r"sensors\[0\].min_range: duplicate key 'min_range'"),
    ("seed: §!!int 3\n", "got the tag !!int, expected a plain value"),
    ("sensors: §!include a.yaml\n", "got the tag !include, expected a plain value; .* `extends: FILE`"),
    ("seed: &x 1\nkeyframe: §&x home\n", "got the anchor &x a second time, expected another name"),
    ("a: §!!python/object/apply:os.system [ls]\n", "got the tag !!python/object/apply:os.system, expected a plain"),
    ("? §[a, b]\n: c\n", "a key must be text"),
    # the file as a rig
    ("§3\n", "must be a mapping of extends, model, .*, got 3"),
    ("§- a\n", "must be a mapping of extends, model, .*, got"),
    ("§sed: 3\n" + ONE + "}", "sed: unknown key 'sed', expected one of .*; did you mean 'seed'?"),
    ("§3: 3\n" + ONE + "}", "3: unknown key '3'"),
    ("§<<: {seed: 3}\n" + ONE + "}", "got a merge key <<, which is not of YAML 1.2; expected the keys themselves"),
    ("§include: a.yaml\n" + ONE + "}", "unknown key 'include', .*did you mean 'extends'?"),
    ("§model: models/robot.xml\n", "sensors: required, but not given"),
    (HEAD + "sensors: §[]\n", "sensors: must have at least 1 sensor, got none"),
    (HEAD + "sensors: §{a: 1}\n", "sensors: must be a list, got"),
    (HEAD + "§sensors:\n", r"sensors: must be a list, got nothing \(null\)"),
    (HEAD + "sensors: [§3]\n", r"sensors\[0\]: must be a mapping, got 3"),
    (ONE + ", rate_hz: §[10]}", r"rate_hz: must be a number, got \[10\] \(.*\[Hz\]"),
    ("seed: §-1\n" + ONE + "}", "seed: must be greater than or equal to 0, got -1"),
    ("seed: §1.5\n" + ONE + "}", "seed: must be an integer, got 1.5"),
    ("seed: §yes\n" + ONE + "}", "seed: must be an integer, got 'yes'"),
    ("seed: §true\n" + ONE + "}", "seed: must be an integer, got True"),
    ("keyframe: §3\n" + ONE + "}", "keyframe: must be a string, got 3"),
    ("export: {transform_rate_hz: §0}\n" + ONE + "}", "export.transform_rate_hz: must be greater than 0, got 0"),
    ("export: {world_frame: §''}\n" + ONE + "}", "export.world_frame: must have at least 1 character, got ''"),
    ("export: {depth_encoding: §8UC1}\n" + ONE + "}", "export.depth_encoding: must be '32FC1' or '16UC1', got '8UC1'"),
    (ONE.replace("models/robot.xml", "§3") + "}", "model: must be a string, got 3"),
    # a sensor
    (HEAD + "sensors:\n  - §{name: a, mount: {}}\n", r"sensors\[0\].type: required, one of lidar, depth_cam"),
    (HEAD + "sensors:\n  - type: §ldar\n", r"sensors\[0\].type: unknown type 'ldar', .*'lidar'?"),
    (HEAD + "sensors:\n  - type: §[a]\n", r"sensors\[0\].type: unknown type \['a'\]"),
    (ONE + ", §max_rnge: 3}", r"sensors\[0\].max_rnge: unknown key .*did you mean 'max_range'?"),
    (
        CAMERA.replace("§", "")[:-1] + ", §width: 640}",
        "unknown key 'width', expected one of resolution, fov_x_deg, .*did you mean 'resolution'",
    ),
    (ONE + ", §lidar: 3}", r"sensors\[0\].lidar: unknown key 'lidar', expected one of"),
    (ONE + ", §fov_y_deg: 60}", r"sensors\[0\].fov_y_deg: unknown key 'fov_y_deg', which depth_camera has, expected"),
    (ONE + ", §spacing: 0.1}", r"unknown key 'spacing', which height_scan has, expected one of"),
    (ONE.replace("{name", "{§resolution: [4, 3], name") + "}", r"'resolution', which depth_camera has, expected"),
    (CAMERA.replace("§", "").replace("name: a", "name: a, §rosette: 1"), r"'rosette', which lidar has, expected"),
    (ONE + ", §dropout: 0.1}", r"sensors\[0\].dropout: unknown key 'dropout', which belongs in 'noise'"),
    (ONE + ", §pos: [0, 0, 1]}", r"sensors\[0\].pos: unknown key 'pos', which belongs in 'mount'"),
    (ONE + ", §preset: x}", r"sensors\[0\].preset: duplicate key"),
    (ONE + ", max_range: §100 m}", r"max_range: must be a number, got '100 m' \(.*\[m\]"),
    (ONE + ", max_range: §.nan}", "max_range: must be .*, got nan"),
    (ONE + ", min_range: §.inf}", "min_range: must be a finite number, got inf"),
    (ONE + ", min_range: 5, max_range: §2}", "max_range: must be above min_range, 5 m, got 2 m"),
    (ONE.replace("{n", "§{n") + ", min_range: 200}", "max_range: must be above min_range, 200 m, got 100 m"),
    (ONE + ", rate_hz: §10Hz}", r"rate_hz: must be a number, got '10Hz' \(.*\[Hz\]"),
    (ONE + ", rate_hz: §1:30}", "rate_hz: must be a number, got '1:30'"),
    (ONE + ", max_range: §−5}", r"max_range: must be a number, got '−5' with U\+2212 MINUS SIGN \(.*\[m\]"),
    (ONE + ", columns: §0}", "columns: must be greater than or equal to 1, got 0"),
    (ONE + ", elevation_deg: [1, §x]}", r"sensors\[0\].elevation_deg\[1\]: must be a number, got 'x'"),
    (ONE + ", §filter: }", r"sensors\[0\].filter: must be a mapping of geom_groups, .*, got nothing \(null\)"),
    (ONE + ", filter: {static: §2020-01-01}}", "filter.static: must be true or false, got '2020-01-01'"),
    (
        ONE + ", filter: {§rate_hz: 3}}",
        "filter.rate_hz: unknown key 'rate_hz', which belongs beside 'filter', not in it",
    ),
    (ONE + "}\n  - {name: §a, " + LIDAR + ", mount: {}}", "'a' is the name of sensors.0. already"),
    (ONE.replace("torso", "torso, pos: §[1, 2]") + "}", "mount.pos: must have 3 values, got 2"),
    (ONE.replace("body", "§bdy") + "}", r"sensors\[0\].mount.bdy: unknown key 'bdy', .*'body'?"),
    (ONE.replace("velodyne_vlp16", "§velodyne_vlp61") + "}", "preset: unknown preset .*'velodyne_vlp16'?"),
    (ONE.replace("name: a", "name: §a/b") + "}", r"sensors\[0\].name: must match .* got 'a/b'"),
    (ONE.replace("{name: a, ", "§{") + "}", r"sensors\[0\].name: required, but not given"),
    # the rig on its model
    (ONE.replace("torso", "§torzo") + "}", "mount.body: no body 'torzo' in the model, .*'torso'?"),
    (ONE.replace("body: torso", "site: §tip") + "}", "mount.site: no site 'tip' .* expected one of mast"),
    (ONE.replace("body: torso", "camera: §hed") + "}", "no camera 'hed' in the model, .*'head'?"),
    (ONE + ", filter: {exclude_bodies: [world, §leg]}}", r"exclude_bodies\[1\]: no body 'leg' in"),
    ("keyframe: §hom\n" + ONE + "}", "keyframe: no keyframe 'hom' in the model, .*'home'?"),
    (CAMERA, r"sensors\[0\]: resolution required: camera 'bare' of the model has none"),
    (ONE.replace("models/robot.xml", "§root.xml") + "}", "model: .*root.xml is not a file, expected a MuJoCo model"),
    (ONE.replace("models/robot.xml", "§models") + "}", "model: .*models is not a file"),
    (ONE.replace("models/robot.xml", "§rig.yaml") + "}", "model: .*rig.yaml: a YAML file, expected a MuJoCo model"),
    ("§" + ONE.removeprefix(HEAD) + "}", "model: required, as no model was given otherwise"),
]


def place_of(text: str) -> str | None:
    """line:column of the § in the text; None without one."""
    before = text.partition("§")[0].split("\n")
    return f"{len(before)}:{len(before[-1]) + 1}" if "§" in text else None


@pytest.mark.parametrize(("text", "message"), FAULTS)
def test_fault_is_named_at_its_place(folder: Path, text: str, message: str) -> None:
    path, place = write(folder, text.replace("§", "")), place_of(text)
    error = error_of(path)
    first = error.splitlines()[0]
    assert first.startswith(f"{path}:{place}: " if place else f"{path}: "), error
    assert re.search(message.replace("?", r"\?"), first), error
    assert len(re.findall(re.escape(str(path)) + r":\d", error)) == (1 if place else 0), error


def test_the_line_is_shown_with_a_caret(folder: Path) -> None:
    path = write(folder, ONE.replace("body", "bdy") + "}")
    line, caret = error_of(path).splitlines()[1:]
    assert line == "      - {name: a, type: lidar, preset: velodyne_vlp16, mount: {bdy: torso}}"
    assert caret == " " * line.index("bdy") + "^"


def test_an_unknown_key_is_told_beside_a_sensor_that_is_no_mapping(folder: Path) -> None:
    error = error_of(write(folder, "sed: 3\n" + HEAD + "sensors: [3]\n"))
    assert "sed: unknown key 'sed'" in error
    assert "sensors[0]: must be a mapping, got 3" in error


def test_all_faults_are_told_at_once_in_the_files_order(folder: Path) -> None:
    """Faults of the file, names that the model does not have, and faults of sensors, together."""
    path = write(
        folder,
        """\
model: models/robot.xml
sed: 3
keyframe: nowhere
sensors:
  - {name: a, type: lidar, preset: velodyne_vlp16, mount: {body: leg}, filter: {exclude_bodies: [x, y]}}
  - name: a
    type: depth_camera
    mount: {camera: head}
    fov_y_deg: 200
    resolution: [0, 0]
  - {name: b, type: height_scan, mount: {site: nose}, size: [1, 1], spacing: 0.1}
""",
    )
    places = re.findall(re.escape(str(path)) + r":(\d+:\d+): ([^:]+):", error_of(path))
    assert places == [
        ("2:1", "sed"),
        ("3:11", "keyframe"),
        ("5:66", "sensors[0].mount.body"),
        ("5:98", "sensors[0].filter.exclude_bodies[0]"),
        ("5:101", "sensors[0].filter.exclude_bodies[1]"),
        ("6:11", "sensors[1].name"),
        ("9:16", "sensors[1].fov_y_deg"),
        ("10:18", "sensors[1].resolution[0]"),
        ("10:21", "sensors[1].resolution[1]"),
        ("11:48", "sensors[2].mount.site"),
    ]


def test_mounts_and_filters_are_checked_in_sensors_with_other_faults(folder: Path) -> None:
    path = write(
        folder,
        """\
model: models/robot.xml
sensors:
  - {name: a, type: lidar, preset: velodyne_vlp61, mount: {body: leg}, filter: {exclude_bodies: [x]}}
  - {name: b, type: ladar, mount: {site: nose, euler_deg: 3}, filter: {exclude_bodies: [y]}}
  - {name: c, type: lidar, colums: 3, mount: torso, filter: {exclude_subtree: true}}
""",
    )
    assert re.findall(r"(?m)^\S+:(\d+:\d+): ([^:]+):", error_of(path)) == [
        ("3:36", "sensors[0].preset"),
        ("3:66", "sensors[0].mount.body"),
        ("3:98", "sensors[0].filter.exclude_bodies[0]"),
        ("4:21", "sensors[1].type"),
        ("4:59", "sensors[1].mount.euler_deg"),
        ("4:89", "sensors[1].filter.exclude_bodies[0]"),
        ("5:28", "sensors[2].colums"),
        ("5:46", "sensors[2].mount"),
        ("5:61", "sensors[2].filter"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [*a]\n", r"a\[0\]: contains itself"),
        ("[" * 1000, "nested too deeply|not valid YAML"),
        ("a: " + "&x [1]\n", "unknown key"),
        ("a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: &d [*c, *c]\n", "unknown key 'd'"),
    ],
)
def test_odd_yaml_is_refused_like_any_other(folder: Path, text: str, message: str) -> None:
    assert re.search(message, error_of(write(folder, text)))


@pytest.mark.parametrize("separator", [", ", ",\n "], ids=["in one line", "in many"])
def test_of_very_many_faults_the_first_are_shown(folder: Path, separator: str) -> None:
    values = separator.join(["x"] * 5000)
    head = "model: models/robot.xml\n"
    text = head + f"sensors: [{{name: a, type: lidar, mount: {{}}, columns: 1, elevation_deg: [{values}]}}]\n"
    lines = error_of(write(folder, text)).splitlines()
    assert (len(lines), lines[-1]) == (301, "... and 4900 more")
    assert max(map(len, lines)) < 600
    assert all(
        "x" in line and line[len(caret) - 1] == "x" for line, caret in zip(lines[1:-1:3], lines[2:-1:3], strict=True)
    )


def test_a_list_too_long_to_be_read_is_told_where_it_becomes_so(folder: Path) -> None:
    text = "model: robot.xml\nsensors:\n" + "  - {}\n" * 200_000
    assert re.search(r":100000:5: .*more than 100000 values", error_of(write(folder, text)))


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    assert error_of(tmp_path / "rig.yaml") == f"{tmp_path / 'rig.yaml'}: cannot be read: No such file or directory"
    assert error_of(tmp_path) == f"{tmp_path}: cannot be read: Is a directory"
    (tmp_path / "latin.yaml").write_bytes(b"b: 1\r\na: caf\xe9\n")
    assert (
        error_of(tmp_path / "latin.yaml")
        == f"{tmp_path / 'latin.yaml'}:2:7: not UTF-8 text: byte 12 is 0xE9; expected YAML in UTF-8"
    )


@pytest.mark.parametrize("name", ["missing.xml", "broken.xml", "broken.mjb"])
def test_a_given_model_that_cannot_be_used_is_named(folder: Path, name: str) -> None:
    for broken in ("broken.xml", "broken.mjb"):
        (folder / broken).write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    path = folder / name
    expected = "is not a file" if name == "missing.xml" else "does not compile: "
    assert error_of(write(folder, GOOD), path).startswith(f"{path} {expected}")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((None,), "rig file: got NoneType, expected str or Path"),
        (("rig.yaml", 3), "model: got int, expected MjModel or str or Path or None"),
    ],
)
def test_arguments_of_other_types_are_refused(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_rig(*arguments)


@pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")
def test_load_rig_gives_a_rig(folder: Path) -> None:
    rig = load_rig(write(folder, GOOD), device="cpu")
    assert [sensor.name for sensor in rig.sensors] == ["top", "front", "feet"]
    assert rig.model.nkey == 1


@pytest.mark.parametrize("given", [False, True])
def test_links_that_a_urdf_loses_are_explained(tmp_path: Path, given: bool) -> None:
    link = '<link name="{}"><collision><geometry><box size="1 1 1"/></geometry></collision></link>'
    joint = '<joint name="j" type="fixed"><parent link="base"/><child link="eye"/></joint>'
    robot = f'<robot name="r">{{}}{link.format("base")}{link.format("eye")}{joint}</robot>'
    (tmp_path / "r.urdf").write_text(robot.format(""))
    sensor = "{name: a, type: lidar, mount: {body: eye}, elevation_deg: [0], columns: 4}"
    rig = write(tmp_path, f"model: r.urdf\nsensors: [{sensor}]\n")
    model = tmp_path / "r.urdf" if given else None
    with pytest.raises(InputError) as caught:
        open_rig(rig, model)
    kept = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    assert "no body 'eye' in the model" in str(caught.value)
    assert (": model: MuJoCo merges" in str(caught.value)) != given
    assert "MuJoCo merges links of a URDF that are fixed to another, and leaves out visuals" in str(caught.value)
    assert f"within <robot> {kept} keeps both" in str(caught.value)
    (tmp_path / "r.urdf").write_text(robot.format(kept))
    open_rig(rig, model)
