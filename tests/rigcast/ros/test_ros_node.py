"""The live node, on a stand-in for rclpy that keeps what is published."""

import importlib
import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mcap_ros2._dynamic import generate_dynamic
from ros_bags import cloud, read_bag, seconds
from typer.testing import CliRunner

import rigcast
from rigcast.cli import app
from rigcast.ros.messages import typestore

pytestmark = pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")

FAKES = Path(__file__).parent / "fake_ros"
XML = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <body name="cart" pos="0 0 1"><joint name="slide" type="slide" axis="1 0 0"/><geom type="sphere" size="0.1"/></body>
  </worldbody>
</mujoco>
"""
RIG = """\
model: cart.xml
sensors:
  - {name: top, type: lidar, mount: {body: cart}, elevation_deg: [-5, 5], columns: 12, rate_hz: 50}
  - {name: eye, type: depth_camera, mount: {body: cart}, resolution: [6, 4], fov_y_deg: 60, rate_hz: 50}
"""


@pytest.fixture
def rclpy(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(FAKES))
    yield importlib.import_module("rclpy")
    for name in set(sys.modules) - before:
        if (getattr(sys.modules[name], "__file__", None) or "").startswith(str(FAKES)):
            del sys.modules[name]


@pytest.fixture
def rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "cart.xml").write_text(XML)
    (tmp_path / "rig.yaml").write_text(RIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "rig.yaml"


def decoded(publisher: Any) -> list[Any]:
    kind = f"{publisher.kind.__module__.replace('.', '/')}/{publisher.kind.__name__}"
    text, _ = typestore().generate_msgdef(kind, ros_version=2)
    return [generate_dynamic(kind, text)[kind](data) for data in publisher.published]


def test_the_node_publishes_what_the_bag_holds(rclpy: Any, rig_file: Path, tmp_path: Path) -> None:
    rig = rigcast.load_rig(rig_file, device="cpu")
    data = mujoco.MjData(rig.model)
    with (
        rigcast.RosNode(rig.model, rig.sensors, name="simulated") as node,
        rigcast.Recorder(tmp_path / "out", rig.model, rig.sensors, ["mcap"]) as recorder,
    ):
        for _ in range(10):
            mujoco.mj_step(rig.model, data)
            frames = rig.step(data)
            node.step(data, frames)
            recorder.step(data, frames)
    assert rclpy.log == ["init", "destroy_node", "shutdown"]
    (ros_node,) = rclpy.nodes
    assert ros_node.name == "simulated"
    bag = read_bag(tmp_path / "out" / "rosbag2_mcap")
    assert {read.topic for read in bag} == set(ros_node.publishers)
    for topic, publisher in ros_node.publishers.items():
        recorded = [read.message for read in bag if read.topic == topic]
        assert list(map(repr, recorded)) == list(map(repr, decoded(publisher))), topic
        latched = topic in ("/tf_static", "/rigcast/ids")
        assert publisher.qos.durability.name == ("TRANSIENT_LOCAL" if latched else "VOLATILE")
        assert publisher.qos.depth == (1 if latched else 10)
    points = cloud(decoded(ros_node.publishers["/top/points"])[0])
    assert points["range"].shape == (2, 12)
    np.testing.assert_array_equal(points["column"][0], np.arange(12))


def test_a_running_rclpy_is_left_running(rclpy: Any, rig_file: Path) -> None:
    rclpy.init()
    rig = rigcast.load_rig(rig_file, device="cpu")
    rigcast.RosNode(rig.model, rig.sensors).close()
    assert rclpy.log == ["init", "destroy_node"]


@pytest.mark.usefixtures("rig_file")
def test_from_the_shell_it_publishes_in_real_time(rclpy: Any) -> None:
    result = CliRunner().invoke(app, ["publish", "rig.yaml", "--duration", "0.1", "--device", "cpu"])
    assert result.exit_code == 0, result.output
    assert "published 10 frames" in result.output
    clocks = [seconds(message.clock) for message in decoded(rclpy.nodes[0].publishers["/clock"])]
    assert clocks[0] == 0.0
    assert clocks[-1] == pytest.approx(0.1)


@pytest.mark.usefixtures("rig_file", "rclpy")
@pytest.mark.parametrize(
    ("speed", "passed", "slept"), [("1", 0.0, [0.005, 0.01, 0.015, 0.02]), ("0.5", 0.015, [0, 0.005, 0.015, 0.025])]
)
def test_it_sleeps_until_real_time_is_simulated_time_over_speed(
    speed: str, passed: float, slept: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where steps took this long before the first sleep, and none afterwards."""
    sleeps: list[float] = []
    monkeypatch.setattr("rigcast.cli.publish.perf_counter", itertools.chain([0.0], itertools.repeat(passed)).__next__)
    monkeypatch.setattr("rigcast.cli.publish.sleep", sleeps.append)
    result = CliRunner().invoke(app, ["publish", "rig.yaml", "--duration", "0.02", "--speed", speed, "--device", "cpu"])
    assert result.exit_code == 0, result.output
    assert sleeps == pytest.approx(slept)


@pytest.mark.usefixtures("rig_file", "rclpy")
@pytest.mark.parametrize(("seed", "expected"), [((), 3), (("--seed", "5"), 5)])
def test_a_controller_gets_the_seed(tmp_path: Path, seed: tuple[str, ...], expected: int) -> None:
    (tmp_path / "told.py").write_text("def tell(model, seed):\n    print('seed', seed)\n    return lambda data: None\n")
    moving = ("--controller", "told:tell", "--set", "seed=3", *seed)
    result = CliRunner().invoke(app, ["publish", "rig.yaml", "--duration", "0.01", "--device", "cpu", *moving])
    assert result.exit_code == 0, result.output
    assert f"seed {expected}\n" in result.output


@pytest.mark.usefixtures("rig_file")
def test_ctrl_c_ends_it_and_takes_the_node_down(rclpy: Any) -> None:
    def press(publisher: Any) -> None:
        if publisher.topic == "/top/points":
            raise KeyboardInterrupt

    rclpy.on_publish = press
    result = CliRunner().invoke(app, ["publish", "rig.yaml", "--device", "cpu", "--set", "seed=3"])
    assert result.exit_code == 130
    assert rclpy.log == ["init", "destroy_node", "shutdown"]


@pytest.mark.usefixtures("rig_file")
def test_without_rclpy_it_says_what_is_missing() -> None:
    result = CliRunner().invoke(app, ["publish", "rig.yaml"])
    assert result.exit_code == 2
    assert "publishing needs rclpy, which comes with ROS 2" in result.output
    assert "--format mcap" in result.output


@pytest.mark.usefixtures("rig_file", "rclpy")
@pytest.mark.parametrize("speed", ["0", "-1", "nan"])
def test_a_speed_that_is_none_is_refused(speed: str) -> None:
    result = CliRunner().invoke(app, ["publish", "rig.yaml", "--speed", speed])
    assert (result.exit_code, "--speed: got" in result.output) == (2, True)
