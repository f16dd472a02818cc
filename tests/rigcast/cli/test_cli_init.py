"""`rigcast init`: a first rig for a model."""

from pathlib import Path

import mujoco
import pytest
from ruamel.yaml import YAML
from shell_calls import call

from rigcast.rig_file import open_rig
from rigcast.rig_file.starter import starter_rig

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
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
