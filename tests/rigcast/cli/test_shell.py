"""The shell: overrides, JSON for programs, completion, a first rig, a schema for editors."""

import json
import runpy
from pathlib import Path
from typing import Any

import jsonschema
import mujoco
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from rigcast.cli import app
from rigcast.rig_file import open_rig
from rigcast.rig_file.starter import starter_rig
from rigcast.schema import dataset_schema, rig_schema

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
EXAMPLES = sorted([*CONFIGS.glob("*.yaml"), *(CONFIGS.parent / "examples").rglob("*.yaml")])


def call(*arguments: str | Path) -> tuple[int, str]:
    """Exit code and what was printed."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def test_values_are_set_from_the_shell() -> None:
    code, output = call("validate", CONFIGS / "minimal.yaml", "--set", "sensors.top.rate_hz=5", "--set", "seed=3")
    assert code == 0, output
    assert "5 Hz" in output


def test_a_wrong_value_is_shown_with_a_caret() -> None:
    code, output = call("validate", CONFIGS / "minimal.yaml", "--set", "sensors.top.rate_hz=fast")
    assert code == 2
    place, line, caret = output.splitlines()
    assert place.startswith("--set:1:21: sensors[0].rate_hz: must be a number, got 'fast'")
    assert (line, caret) == ("    sensors.top.rate_hz=fast", "                        ^")


@pytest.mark.parametrize(
    "arguments", [["validate", CONFIGS / "minimal.yaml"], ["presets"], ["presets", "velodyne_vlp16"]]
)
def test_json_on_standard_output_stands_alone(arguments: list[Any]) -> None:
    code, output = call(*arguments, "--json", "-")
    assert code == 0
    assert json.loads(output, parse_constant=pytest.fail), "Infinity and NaN are Python's, and no JSON"


def test_validate_tells_programs_all_about_a_rig(tmp_path: Path) -> None:
    call("validate", CONFIGS / "minimal.yaml", "--json", tmp_path / "rig.json")
    document = json.loads((tmp_path / "rig.json").read_text())
    (top,) = document["sensors"]
    assert document["files"] == [str(CONFIGS / "minimal.yaml")]
    assert (top["name"], top["shape"], top["max_range"], top["mount"]["body"]) == ("top", [16, 1808], 100.0, "robot")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("rigcast va", ["validate"]),
        ("rigcast presets vel", ["velodyne_vlp16"]),
        ("rigcast run --du", ["--duration"]),
        ("rigcast run --se", ["--seed", "--set"]),
    ],
)
def test_the_shell_completes(words: str, expected: list[str]) -> None:
    asked = {"_RIGCAST_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    found = CliRunner().invoke(app, env=asked, prog_name="rigcast").stdout.split()
    assert set(expected) <= set(found)
    assert all(word.startswith(words.rpartition(" ")[2]) for word in found)


@pytest.mark.parametrize(
    "command", ["init", "run", "check", "validate", "watch", "view", "presets", "schema", "dataset", "bench"]
)
def test_help_has_examples(command: str) -> None:
    code, output = call(command, "--help")
    assert code == 0
    assert f"rigcast {command}" in output.partition("Examples:")[2]


def test_help_tells_the_exit_codes() -> None:
    assert "Exit codes: 0 done, 1 a ray is wrong" in " ".join(call("--help")[1].split())


ROBOT = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <camera name="true" resolution="64 48"/>
    <body name="cart: one">
      <freejoint/>
      <geom size="0.1"/>
      <site name="front lidar"/> <site name="front_lidar"/> <site name="depth#"/> <site name="tip"/>
      <camera name="side" projection="orthographic"/>
    </body>
  </worldbody>
  <keyframe><key name="it's"/><key name="other"/></keyframe>
</mujoco>
"""
STILL = "<mujoco><worldbody><geom type='plane' size='0 0 1'/></worldbody></mujoco>"
ONE_STATE = STILL.replace("</mujoco>", "<keyframe><key name='home'/></keyframe></mujoco>")
PLAIN = """
<mujoco>
  <worldbody>
    <body name="a"><geom size="1"/><body name="b"><joint/><geom size="1"/><site name="tip"/></body></body>
  </worldbody>
</mujoco>
"""
STARTERS = {
    "robot": (ROBOT, ["true", "side", "depth_", "front_lidar", "front_lidar_2"], "others are other"),
    "still": (STILL, ["lidar"], "fixed to the world"),
    "one state": (ONE_STATE, ["lidar"], "keyframe: home    # the state to start from\n"),
    "plain": (PLAIN, ["lidar"], "Sites that a sensor can be mounted on: tip."),
}


@pytest.mark.parametrize("kind", STARTERS)
def test_the_first_rig_of_a_model_is_valid(kind: str, tmp_path: Path) -> None:
    xml, names, remark = STARTERS[kind]
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "it.xml").write_text(xml)
    code, output = call("init", tmp_path / "models" / "it.xml", "--out", tmp_path / "rig.yaml")
    assert code == 0, output
    config, _ = open_rig(tmp_path / "rig.yaml")
    assert [sensor.name for sensor in config.sensors] == names
    assert remark in (tmp_path / "rig.yaml").read_text()
    assert "model: models/it.xml " in (tmp_path / "rig.yaml").read_text()


# (the site, and what the first rig has on it: preset and rate)
SITES = [
    ("mid360", "livox_mid360", 10),
    ("front_D455-frame", "realsense_d455", 30),
    ("os1_lidar", "ouster_os1_128", 10),
    ("velodyne_vlp32c", "velodyne_vlp32c", 10),
    ("kinect_v2", "kinect_v2", 30),
    ("utm30lx", "hokuyo_utm30lx", 40),
    ("laser_a1", "velodyne_vlp16", 10),
    ("camera_d", "realsense_d435", 30),
]


@pytest.mark.parametrize(("site", "preset", "rate_hz"), SITES, ids=[site for site, *_ in SITES])
def test_the_first_rig_has_the_device_that_a_site_is_named_after(site: str, preset: str, rate_hz: float) -> None:
    model = mujoco.MjModel.from_xml_string(PLAIN.replace('"tip"', f'"{site}"'))
    (sensor, *_) = YAML(typ="safe", pure=True).load(starter_rig(model, "it.xml", "s.json"))["sensors"]
    assert (sensor["preset"], sensor["mount"], sensor["rate_hz"]) == (preset, {"site": site}, rate_hz)


# A robot as URDFs describe them, with a link for each device and frames below it; sensors are on the links.
LINKS = """
<mujoco>
  <worldbody>
    <body name="base_link">
      <freejoint/>
      <geom size="0.1"/>
      <body name="laser_link" pos="0.3 0 0"><geom size="0.03"/></body>
      <body name="top_mid360_link" pos="0 0 0.3"><geom size="0.03"/></body>
      <body name="camera_link" pos="0.2 0 0"><geom size="0.02"/>
        <body name="camera_depth_frame"><body name="camera_depth_optical_frame"/></body>
      </body>
      <body name="eye_camera" pos="0 0.2 0"><body name="eye"><camera name="eye"/></body></body>
      <body name="velodyne" pos="0 0 0.2"><site name="velodyne_site"/></body>
      <body name="imu_link"/>
      <body name="motorized_wheel"><geom size="0.05"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def test_the_first_rig_has_sensors_on_bodies_named_like_devices(tmp_path: Path) -> None:
    (tmp_path / "it.xml").write_text(LINKS)
    code, output = call("init", tmp_path / "it.xml", "--out", tmp_path / "rig.yaml")
    assert code == 0, output
    config, _ = open_rig(tmp_path / "rig.yaml")
    mounts = {sensor.name: sensor.mount.model_dump(exclude_unset=True) for sensor in config.sensors}
    assert mounts == {
        "eye": {"camera": "eye"},
        "camera_link": {"body": "camera_link"},
        "velodyne_site": {"site": "velodyne_site"},
        "laser_link": {"body": "laser_link"},
        "top_mid360_link": {"body": "top_mid360_link"},
    }
    presets = {sensor.name: sensor.preset for sensor in config.sensors}
    assert presets["top_mid360_link"] == "livox_mid360"
    code, output = call("validate", tmp_path / "rig.yaml")
    assert "is within geom" not in output


def test_the_first_rig_leaves_the_robot_out() -> None:
    text = starter_rig(mujoco.MjModel.from_xml_string(ROBOT), "it.xml", "s.json")
    assert text.count("filter: {exclude_bodies: ['cart: one'], exclude_subtree: true}") == 2


def test_init_writes_over_nothing_unless_forced(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("mine")
    code, output = call("init", CONFIGS / "minimal.xml", "--out", rig)
    assert (code, rig.read_text()) == (2, "mine")
    assert "already exists; --force overwrites it" in output
    assert call("init", CONFIGS / "minimal.xml", "--out", rig, "--force")[0] == 0
    assert "robot" in rig.read_text()


def test_init_makes_the_folder_of_its_rig(tmp_path: Path) -> None:
    rig = tmp_path / "rigs" / "my first" / "rig.yaml"
    code, output = call("init", CONFIGS / "minimal.xml", "--out", rig)
    assert code == 0, output
    assert f"try `rigcast validate '{rig}'`" in output, "it can be pasted, spaces or not"
    assert open_rig(rig)[1].nsite == mujoco.MjModel.from_xml_path(str(CONFIGS / "minimal.xml")).nsite


def test_init_names_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, output = call("init", CONFIGS / "minimal.xml", "--out", tmp_path / "file" / "rig.yaml")
    assert code == 2
    assert f"{tmp_path / 'file'}: the output folder cannot be written" in output


@pytest.mark.parametrize("kind", ["rig", "dataset"])
def test_the_shipped_schema_is_the_one_that_is_printed(kind: str) -> None:
    shipped = json.loads((CONFIGS / f"{kind}.schema.json").read_text())
    assert shipped == json.loads(call("schema", kind)[1]), f"run: rigcast schema {kind} > configs/{kind}.schema.json"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_every_example_names_the_schema_and_keeps_to_it(path: Path) -> None:
    first, _, _ = path.read_text().partition("\n")
    assert first.startswith("# yaml-language-server: $schema=")
    assert (path.parent / first.partition("=")[2]).resolve() == CONFIGS / "rig.schema.json"
    jsonschema.validate(YAML(typ="safe", pure=True).load(path), rig_schema())


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("datasets/*.yaml")), ids=lambda path: path.name)
def test_every_data_set_names_its_schema_and_keeps_to_it(path: Path) -> None:
    first, _, _ = path.read_text().partition("\n")
    assert (path.parent / first.partition("=")[2]).resolve() == CONFIGS / "dataset.schema.json"
    jsonschema.Draft202012Validator.check_schema(dataset_schema())
    jsonschema.validate(YAML(typ="safe", pure=True).load(path), dataset_schema())


SENSOR = "{name: a, type: lidar, mount: {}, elevation_deg: [0], columns: 4"


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        (f"sensors: [{SENSOR}}}]", True),
        (f"sensors: [{SENSOR}, rate: 3}}]", False),
        ("sensors: [{name: a, type: lidar}]", False),
        ("extends: a.yaml\nsensors: [{name: a, rate_hz: 3}]", True),
        ("extends: [a.yaml, b.yaml]", True),
        ("extends: 3", False),
        ("seed: 3", False),
        (f"sensors: [{SENSOR}, repeat: {{k: [1, 2]}}, rate_hz: $k}}]", True),
        ("sensors: [{name: a$k, type: lidar, mount: {pos: [0, $k, 1]}, repeat: {k: [1]}}]", True),
        (f"sensors: [{SENSOR}, rate_hz: fast}}]", False),
        (f"sensors: [{SENSOR}, repeat: [1]}}]", False),
    ],
)
def test_the_schema_takes_what_may_be_written(text: str, fits: bool) -> None:
    jsonschema.Draft202012Validator.check_schema(rig_schema())
    faults = list(jsonschema.Draft202012Validator(rig_schema()).iter_errors(YAML(typ="safe", pure=True).load(text)))
    assert (not faults) == fits, faults


def test_the_yaml_reference_has_every_key() -> None:
    reference = runpy.run_path(str(CONFIGS.parent / "docs" / "site.py"))["yaml_reference"]()
    schema = rig_schema()
    keys = {key for part in (schema, *schema["$defs"].values()) for key in part["properties"]}
    assert [key for key in sorted(keys) if f"| `{key}` |" not in reference] == []
