"""A mount places the sensor on bodies, sites, cameras and the world, with its offset."""

from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.mount import Mount

XML = """
<mujoco>
  <worldbody>
    <body name="torso" pos="1 2 3" euler="10 20 30">
      <freejoint/>
      <geom size="0.1"/>
      <site name="mast" pos="0.1 0.2 0.3" euler="0 90 0"/>
      <body name="head" pos="0 0 0.5">
        <joint axis="0 0 1"/>
        <geom size="0.1"/>
        <camera name="eye" pos="0.2 0 0" xyaxes="0 -1 0 0.1 0 1"/>
      </body>
    </body>
    <camera name="wall" pos="0 0 2"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


@pytest.fixture
def data(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] += np.random.default_rng(3).normal(scale=0.3, size=model.nq)
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.parametrize(
    ("mount", "position", "rotation", "body"),
    [
        (Mount(), "zero", "eye", 0),
        (Mount(body="world"), "zero", "eye", 0),
        (Mount(body="torso"), "xpos", "xmat", 1),
        (Mount(body="head"), "xpos", "xmat", 2),
        (Mount(site="mast"), "site_xpos", "site_xmat", 1),
    ],
)
def test_without_offset_the_pose_is_the_carriers(
    model: mujoco.MjModel, data: mujoco.MjData, mount: Mount, position: str, rotation: str, body: int
) -> None:
    bound = mount.bind(model)
    pose = bound.pose(data)
    expected = np.eye(4)
    if position != "zero":
        expected[:3, 3] = getattr(data, position)[bound.id]
        expected[:3, :3] = getattr(data, rotation)[bound.id].reshape(3, 3)
    assert pose.dtype == np.float64
    np.testing.assert_allclose(pose, expected, atol=1e-15)
    assert bound.body_id == body


@pytest.mark.parametrize(("camera", "body"), [("eye", 2), ("wall", 0)])
def test_on_a_camera_it_looks_where_the_camera_looks(
    model: mujoco.MjModel, data: mujoco.MjData, camera: str, body: int
) -> None:
    axes = data.camera(camera).xmat.reshape(3, 3)
    bound = Mount(camera=camera, pos=(2, 0, 0)).bind(model)
    pose = bound.pose(data)
    np.testing.assert_allclose(pose[:3, 0], -axes[:, 2], atol=1e-15)
    np.testing.assert_allclose(pose[:3, 2], axes[:, 1], atol=1e-15)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(pose[:3, 3], data.camera(camera).xpos - 2 * axes[:, 2], atol=1e-14)
    assert bound.body_id == body


def test_the_offset_is_in_the_carriers_axes(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    axes, origin = data.body("torso").xmat.reshape(3, 3), data.body("torso").xpos
    pose = Mount(body="torso", pos=(0.1, -0.2, 0.3), euler_deg=(0, 0, 90)).bind(model).pose(data)
    np.testing.assert_allclose(pose[:3, 3], origin + axes @ [0.1, -0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(pose[:3, 0], axes[:, 1], atol=1e-15)


def test_the_pose_follows_its_body(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    bound = Mount(camera="eye").bind(model)
    before = bound.pose(data)
    data.qpos[0] += 5
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(bound.pose(data)[:3, 3] - before[:3, 3], [5, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("euler_deg", "forward", "up"),
    [
        ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
        ((90, 0, 0), (1, 0, 0), (0, -1, 0)),
        ((0, 90, 0), (0, 0, -1), (1, 0, 0)),
        ((0, 0, 90), (0, 1, 0), (0, 0, 1)),
        ((90, 0, 90), (0, 1, 0), (1, 0, 0)),
    ],
)
def test_roll_pitch_yaw(
    euler_deg: tuple[float, float, float],
    forward: tuple[float, float, float],
    up: tuple[float, float, float],
) -> None:
    offset = Mount(euler_deg=euler_deg).offset
    np.testing.assert_allclose(offset[:3, 0], forward, atol=1e-15)
    np.testing.assert_allclose(offset[:3, 2], up, atol=1e-15)


@pytest.mark.parametrize("seed", range(5))
def test_euler_and_quat_are_mujocos_conventions(seed: int) -> None:
    """MuJoCo's "XYZ" is about fixed axes."""
    roll, pitch, yaw = np.random.default_rng(seed).uniform(-180, 180, 3)
    quat, matrix = np.empty(4), np.empty(9)
    mujoco.mju_euler2Quat(quat, np.deg2rad([roll, pitch, yaw]), "XYZ")
    mujoco.mju_quat2Mat(matrix, quat)
    by_euler = Mount(euler_deg=(roll, pitch, yaw)).offset[:3, :3]
    w, x, y, z = 3 * quat
    by_quat = Mount(quat=(w, x, y, z)).offset[:3, :3]
    np.testing.assert_allclose(by_euler, matrix.reshape(3, 3), atol=1e-14, err_msg=f"seed {seed}")
    np.testing.assert_allclose(by_quat, matrix.reshape(3, 3), atol=1e-14, err_msg=f"seed {seed}")


@pytest.mark.parametrize(
    ("mount", "message"),
    [
        (Mount(body="torzo"), "body: no body 'torzo' in the model, .*torso, head; did you mean 'torso'?"),
        (Mount(site="head"), "site: no site 'head' in the model, but a body, expected one of mast"),
        (Mount(camera="eyes"), "camera: no camera 'eyes' .*did you mean 'eye'?"),
        (Mount(body=""), "body: no body '' in the model"),
    ],
)
def test_unknown_names_are_refused(model: mujoco.MjModel, mount: Mount, message: str) -> None:
    with pytest.raises(InputError, match=message):
        mount.bind(model)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"body": "a", "site": "b"}, "at most one of body, site and camera, got body and site"),
        ({"quat": (1, 0, 0, 0), "euler_deg": (0, 0, 0)}, "quat or euler_deg, got both"),
        ({"quat": (0, 0, 0, 0)}, "quat: must be w, x, y, z of a length that is not 0"),
        ({"pos": (0, 0)}, "pos: must have 3 values, got 2$"),
        ({"quat": ()}, "^Mount: quat: must have 4 values, got 0$"),
        ({"pos": (0, 0, 0, 0)}, "pos: must have at most 3 values, got 4"),
        ({"pos": (0, 0, float("nan"))}, r"pos\[2\]: must be a finite number, got nan"),
        ({"pos": 3}, "pos: must be a list, got 3"),
        (
            {"pos": (0, True, 0)},
            r"pos\[1\]: must be a number, got True \(offset x, y, z from the carrier \[m\]\)",
        ),
        ({"bdy": "a"}, "unknown key 'bdy', expected one of body, .*did you mean 'body'?"),
        ({"body": 3}, "body: must be a string, got 3"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Mount(**arguments)


def test_an_argument_without_a_name_is_refused() -> None:
    with pytest.raises(InputError, match=r"Mount: got 'torso' without a name, expected some of body=\.\.\., site="):
        Mount("torso")  # type: ignore[call-arg]


def test_the_docstring_has_the_arguments() -> None:
    assert "\n    body: name of the MuJoCo body that carries the sensor.\n" in str(Mount.__doc__).partition("Args:")[2]


def test_numpy_values_are_taken() -> None:
    arguments: dict[str, Any] = {"pos": np.array([1, 2, 3], np.float32)}
    assert Mount(**arguments) == Mount(pos=(1.0, 2.0, 3.0))
