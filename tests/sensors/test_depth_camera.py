"""A depth camera's rays go through the centres of its pixels, and an MJCF camera's are where MuJoCo sees."""

from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.mount import Mount

XML = """
<mujoco>
  <worldbody>
    <geom size="1"/>
    <camera name="plain" fovy="40" pos="1 2 3" euler="10 20 30"/>
    <camera name="sized" fovy="40" resolution="320 200"/>
    <camera name="sensor" sensorsize="0.004 0.003" resolution="640 480" focal="0.005 0.006"
      principal="0.0004 0.0002"/>
    <camera name="flat" projection="orthographic" fovy="2" resolution="320 200"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def camera(**arguments: Any) -> DepthCamera:
    return DepthCamera(**{"name": "front", "mount": Mount(), "resolution": (8, 6), **arguments})


FOCAL = {"fx": 10.0, "fy": 20.0, "cx": 3.0, "cy": 2.0}


@pytest.mark.parametrize(
    ("optics", "v", "u", "ray"),
    [
        (FOCAL, 0, 0, (-0.25, -0.075, 1)),
        (FOCAL, 5, 7, (0.45, 0.175, 1)),
        ({"fov_y_deg": 90}, 0, 0, (-3.5 / 3, -2.5 / 3, 1)),
        ({"fov_y_deg": 90}, 5, 7, (3.5 / 3, 2.5 / 3, 1)),
        ({"fov_y_deg": 90, "resolution": (3, 3)}, 1, 1, (0, 0, 1)),
    ],
)
def test_ray_goes_through_the_pixels_centre(
    model: mujoco.MjModel, optics: dict[str, Any], v: int, u: int, ray: tuple[float, float, float]
) -> None:
    pattern = camera(**optics).pattern(model)
    np.testing.assert_allclose(pattern.directions[v, u], np.array(ray) / np.linalg.norm(ray), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(pattern.directions, axis=-1), 1, atol=1e-15)


def test_readings_are_rows_by_columns(model: mujoco.MjModel) -> None:
    pattern = camera(**FOCAL).pattern(model)
    assert pattern.shape == (6, 8)
    np.testing.assert_array_equal(pattern.intrinsics, [[10, 0, 3], [0, 20, 2], [0, 0, 1]])
    assert pattern.ring is None
    assert pattern.column is None


def test_the_optical_frame_of_a_camera_is_ros(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    axes = data.camera("plain").xmat.reshape(3, 3)
    spec = camera(mount=Mount(camera="plain"))
    right, down, forward = (spec.mount.bind(model).pose(data)[:3, :3] @ spec.frame_rotation).T
    np.testing.assert_allclose(right, axes[:, 0], atol=1e-15)
    np.testing.assert_allclose(down, -axes[:, 1], atol=1e-15)
    np.testing.assert_allclose(forward, -axes[:, 2], atol=1e-15)


@pytest.mark.parametrize(
    ("name", "arguments", "shape"),
    [
        ("plain", {}, (6, 8)),
        ("sized", {}, (6, 8)),
        ("sized", {"resolution": None}, (200, 320)),
        ("sensor", {"resolution": None}, (480, 640)),
        ("sensor", {"resolution": (100, 50)}, (50, 100)),
        ("flat", {"resolution": None, "fov_y_deg": 50}, (200, 320)),
    ],
)
def test_resolution_defaults_to_the_mjcf_cameras(
    model: mujoco.MjModel, name: str, arguments: dict[str, Any], shape: tuple[int, int]
) -> None:
    assert camera(mount=Mount(camera=name), **arguments).pattern(model).shape == shape


def test_own_optics_win_over_the_mjcf_cameras(model: mujoco.MjModel) -> None:
    here, there = camera(fov_y_deg=70), camera(fov_y_deg=70, mount=Mount(camera="sensor"))
    np.testing.assert_array_equal(here.pattern(model).directions, there.pattern(model).directions)


def test_fovy_of_the_mjcf_camera_is_taken(model: mujoco.MjModel) -> None:
    own, given = camera(mount=Mount(camera="plain")), camera(fov_y_deg=40)
    np.testing.assert_allclose(own.pattern(model).directions, given.pattern(model).directions, atol=1e-15)


def test_sensor_of_the_mjcf_camera_is_taken(model: mujoco.MjModel) -> None:
    """5 x 6 mm over 4 x 3 mm and 640 x 480 pixels; MuJoCo's offset moves the view, 64 and 32 pixels."""
    offset_y = 32 if np.lib.NumpyVersion(mujoco.__version__) >= "3.6.0" else -32
    expected = [[800, 0, 320 - 64], [0, 960, 240 - offset_y], [0, 0, 1]]
    pattern = camera(mount=Mount(camera="sensor"), resolution=None).pattern(model)
    assert pattern.intrinsics is not None
    np.testing.assert_allclose(pattern.intrinsics, expected, rtol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_image_edges_are_those_of_mujocos_frustum(seed: int) -> None:
    """Corners of the image against what `mjv_updateScene` hands to the renderer."""
    random = np.random.default_rng(seed)
    focal, size = random.uniform(0.002, 0.02, 2), random.uniform(0.001, 0.01, 2)
    principal, (width, height) = random.uniform(-0.5, 0.5, 2) * size, random.integers(2, 1000, 2)
    xml = (
        f'<mujoco><worldbody><geom size="1"/><camera name="c" focal="{focal[0]} {focal[1]}" '
        f'sensorsize="{size[0]} {size[1]}" principal="{principal[0]} {principal[1]}" '
        f'resolution="{width} {height}"/></worldbody></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(xml)
    k = camera(mount=Mount(camera="c"), resolution=None).pattern(model).intrinsics
    assert k is not None
    corners = [
        [-k[0, 2] / k[0, 0], -k[1, 2] / k[1, 1]],
        [(width - k[0, 2]) / k[0, 0], (height - k[1, 2]) / k[1, 1]],
    ]
    left, right, bottom, top = frustum_edges(model)
    np.testing.assert_allclose(corners, [[left, -top], [right, -bottom]], rtol=1e-5, err_msg=f"seed {seed}")
    np.testing.assert_allclose(right - left, size[0] / focal[0], rtol=1e-5, err_msg=f"seed {seed}")
    np.testing.assert_allclose(top - bottom, size[1] / focal[1], rtol=1e-5, err_msg=f"seed {seed}")


def frustum_edges(model: mujoco.MjModel) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of what camera 0 sees at distance 1."""
    data, scene, view = mujoco.MjData(model), mujoco.MjvScene(model, 10), mujoco.MjvCamera()
    mujoco.mj_forward(model, data)
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, everything, scene)
    seen = scene.camera[0]
    edges = (
        seen.frustum_center - seen.frustum_width,
        seen.frustum_center + seen.frustum_width,
        seen.frustum_bottom,
        seen.frustum_top,
    )
    left, right, bottom, top = (edge / seen.frustum_near for edge in edges)
    return left, right, bottom, top


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mount": Mount(camera="plain"), "resolution": None}, "resolution required: camera 'plain'"),
        ({"mount": Mount(camera="flat")}, "mount.camera: camera 'flat' of the model is orthographic"),
        ({"mount": Mount(camera="nose")}, "mount.camera: no camera 'nose' in the model"),
    ],
)
def test_unfit_mjcf_cameras_are_refused(model: mujoco.MjModel, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"DepthCamera 'front': {message}"):
        camera(**arguments).pattern(model)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "fov_y_deg, or fx, fy, cx and cy, required unless mounted on an MJCF camera"),
        ({"fov_y_deg": 50, "resolution": None}, "resolution required unless mounted on an MJCF camera"),
        ({"fov_y_deg": 50, "fx": 3.0}, "give fov_y_deg or fx, fy, cx and cy, got fov_y_deg and fx"),
        ({"fx": 3.0, "cy": 1.0}, "give all of fx, fy, cx and cy, got only fx, cy"),
        ({"fov_y_deg": 180}, "fov_y_deg: must be less than 180, got 180"),
        ({"fov_y_deg": 0}, "fov_y_deg: must be greater than 0, got 0"),
        ({"fov_y_deg": "58 deg"}, r"fov_y_deg: must be a number, got '58 deg' \(.*\[deg\]"),
        ({**FOCAL, "fy": 0.0}, "fy: must be greater than 0"),
        ({"fov_y_deg": 50, "resolution": (0, 480)}, r"resolution\[0\]: must be greater than or equal to 1"),
        ({"fov_y_deg": 50, "resolution": (640.5, 480)}, r"resolution\[0\]: must be an integer, got 640.5"),
        ({"fov_y_deg": 50, "resolution": 640}, "resolution: must be a list, got 640"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        camera(**arguments)
