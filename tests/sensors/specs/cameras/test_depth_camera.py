"""A depth camera's rays go through the centres of its pixels; those of an MJCF camera agree with MuJoCo's."""

from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.cameras.ranging import TimeOfFlight
from rigcast.sensors.specs.lens import BrownConrady, KannalaBrandt, Lens
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
        ({"fov_x_deg": 90}, 0, 0, (-7 / 8, -5 / 8, 1)),
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


@pytest.mark.parametrize("principal", [-1e9, 1e9])
def test_rays_at_the_limits_of_the_optics_have_a_length(model: mujoco.MjModel, principal: float) -> None:
    pattern = camera(fx=1e-6, fy=1e-6, cx=principal, cy=principal).pattern(model)
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
    """Corners of the image compared with the frustum that `mjv_updateScene` gives to the renderer."""
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
    """Left, right, bottom and top edges of camera 0's frustum at distance 1."""
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


def test_a_lens_bends_the_rays_of_pixel_centres(model: mujoco.MjModel) -> None:
    lens = BrownConrady(k1=-0.1, k2=0.02, p1=0.001, p2=-0.002)
    pattern = camera(**FOCAL, distortion=lens).pattern(model)
    assert pattern.lens == lens
    seen = lens.distort(pattern.directions) * [FOCAL["fx"], FOCAL["fy"]] + [FOCAL["cx"], FOCAL["cy"]]
    centres = np.stack(np.meshgrid(np.arange(8) + 0.5, np.arange(6) + 0.5), axis=-1)
    np.testing.assert_allclose(seen, centres, atol=1e-11)


def test_a_lens_sits_on_an_mjcf_camera_too(model: mujoco.MjModel) -> None:
    lens = BrownConrady(k1=-0.01)
    plain = camera(mount=Mount(camera="sensor"), resolution=None).pattern(model)
    pattern = camera(mount=Mount(camera="sensor"), resolution=None, distortion=lens).pattern(model)
    np.testing.assert_array_equal(pattern.intrinsics, plain.intrinsics)
    np.testing.assert_allclose(
        lens.distort(pattern.directions), plain.directions[..., :2] / plain.directions[..., 2:], atol=1e-12
    )


@pytest.mark.parametrize("subrays", [2, 3])
@pytest.mark.parametrize("lens", [None, BrownConrady(k1=-0.1, k2=0.02, p1=0.001), KannalaBrandt(k1=0.01)])
def test_subrays_are_the_pixels_of_a_finer_camera(model: mujoco.MjModel, lens: Lens | None, subrays: int) -> None:
    pattern = camera(**FOCAL, distortion=lens, time_of_flight=TimeOfFlight(subrays=subrays)).pattern(model)
    finer = {key: subrays * value for key, value in FOCAL.items()}
    fine = camera(**finer, distortion=lens, resolution=(8 * subrays, 6 * subrays)).pattern(model).directions
    assert pattern.subrays is not None
    by_pixel = fine.reshape(6, subrays, 8, subrays, 3).swapaxes(1, 2).reshape(6, 8, subrays**2, 3)
    np.testing.assert_allclose(pattern.subrays, by_pixel, atol=1e-13)
    assert pattern.directions.shape == (6, 8, 3)


def test_dark_corners_of_a_fisheye_read_nan_and_backward_rays_have_depths_below_0() -> None:
    """An equidistant lens whose image circle of 180 deg to each side has a radius of 31.4 of 40 pixels."""
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="2" rgba="1 1 1 1"/></worldbody></mujoco>')
    spec = camera(resolution=(80, 80), fx=10.0, fy=10.0, cx=40.0, cy=40.0, distortion=KannalaBrandt())
    frame = Rig(model, [spec], "cpu").sense(mujoco.MjData(model))["front"]
    assert isinstance(frame, CameraFrame)
    u, v = np.meshgrid(np.arange(80) - 39.5, np.arange(80) - 39.5)
    theta = np.hypot(u, v) / 10
    expected = np.where(theta <= np.pi, 2.0, np.nan)
    np.testing.assert_allclose(frame.range.numpy(), expected, rtol=1e-6)
    np.testing.assert_allclose(frame.depth.numpy(), expected * np.cos(theta), atol=1e-6)
    np.testing.assert_array_equal(frame.geom_id.numpy(), np.where(theta <= np.pi, 0, -1))


@pytest.mark.parametrize("miss", [np.inf, -np.inf])
def test_backward_rays_miss_as_others_do(miss: float) -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="2"/></worldbody></mujoco>')
    limits = {"max_range": 1.0} if miss > 0 else {"min_range": 3.0}
    spec = camera(resolution=(40, 40), fx=10.0, fy=10.0, cx=20.0, cy=20.0, distortion=KannalaBrandt(), **limits)
    frame = Rig(model, [spec], "cpu").sense(mujoco.MjData(model))["front"]
    assert isinstance(frame, CameraFrame)
    np.testing.assert_array_equal(frame.depth.numpy(), miss)


@pytest.mark.parametrize(
    ("z", "scale", "steps"),
    [
        (2.0, 0.001, 2000),
        (1.2346, 0.001, 1235),
        (1.0, 0.00025, 4000),
        (65.535, 0.001, 65535),
        (65.536, 0.001, 0),
        (0.0004, 0.001, 0),
        (np.inf, 0.001, 0),
        (0.02, 0.001, 0),  # nearer than the minimum
    ],
)
def test_16_bit_depth_is_in_steps_of_its_scale(z: float, scale: float, steps: int) -> None:
    xml = f'<geom type="plane" size="0 0 1" zaxis="-1 0 0" pos="{min(z, 1e3)} 0 0"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{xml}</worldbody></mujoco>")
    minimum = 0.05 if z == 0.02 else 0.0
    spec = camera(**FOCAL, depth_scale=scale, max_range=900.0, min_range=minimum)
    frame = Rig(model, [spec], "cpu").sense(mujoco.MjData(model))["front"]
    assert isinstance(frame, CameraFrame)
    got = frame.depth_16bit.numpy()
    assert got.dtype == np.uint16
    assert got.shape == (6, 8)
    np.testing.assert_array_equal(got, steps)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mount": Mount(camera="plain"), "resolution": None}, "resolution required: camera 'plain'"),
        ({"mount": Mount(camera="flat")}, "mount.camera: camera 'flat' of the model is orthographic"),
        (
            {**FOCAL, "distortion": BrownConrady(k1=-1.0)},
            r"distortion: folds within the image: no ray is seen at pixel \(\d+, \d+\), nor at \d+ others",
        ),
        ({"mount": Mount(camera="nose")}, "mount.camera: no camera 'nose' in the model"),
    ],
)
def test_unfit_mjcf_cameras_are_refused(model: mujoco.MjModel, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"DepthCamera 'front': {message}"):
        camera(**arguments).pattern(model)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "fov_x_deg or fov_y_deg, or fx, fy, cx and cy, required unless mounted on an MJCF camera"),
        ({"fov_y_deg": 50, "resolution": None}, "resolution required unless mounted on an MJCF camera"),
        ({"fov_y_deg": 50, "fx": 3.0}, "give one of fov_x_deg, fov_y_deg, and fx, fy, cx and cy, got fov_y_deg, fx"),
        ({"fov_x_deg": 50, "fov_y_deg": 40}, "give one of fov_x_deg, .*, got fov_x_deg, fov_y_deg"),
        ({"fov_x_deg": 50, "distortion": KannalaBrandt()}, "fx, fy, cx and cy required with distortion, got fov_x_deg"),
        ({"fov_x_deg": 180}, "fov_x_deg: must be less than 180, got 180"),
        ({"fx": 3.0, "cy": 1.0}, "give all of fx, fy, cx and cy, got only fx, cy"),
        ({"fov_y_deg": 50, "distortion": KannalaBrandt()}, "fx, fy, cx and cy required with distortion, got fov_y_deg"),
        ({**FOCAL, "distortion": {"k1": 1.0}}, "distortion.type: required, one of brown_conrady, kannala_brandt"),
        ({**FOCAL, "distortion": {"type": "plumb_bob"}}, "distortion.type: unknown type 'plumb_bob'"),
        ({**FOCAL, "distortion": {"type": "kannala_brandt", "k5": 1.0}}, "distortion.k5: unknown key 'k5'"),
        ({**FOCAL, "distortion": {"type": "brown_conrady", "k1": "a"}}, "distortion.k1: must be a number, got 'a'"),
        ({"fovy": 60.0}, "unknown key 'fovy', .*did you mean 'fov_y_deg'"),
        ({"horizontal_fov": 1.39}, "unknown key 'horizontal_fov', .*did you mean 'fov_x_deg'"),
        ({"near": 0.1}, "unknown key 'near', .*did you mean 'min_range'"),
        ({**FOCAL, "stereo": {"base": 1.0}}, "stereo.base: unknown key 'base', .*did you mean 'baseline'"),
        ({"fov_y_deg": 180}, "fov_y_deg: must be less than 180, got 180"),
        ({"fov_y_deg": 0}, "fov_y_deg: must be greater than 0, got 0"),
        ({"fov_y_deg": "58 deg"}, r"fov_y_deg: must be a number, got '58 deg' \(.*\[deg\]"),
        ({**FOCAL, "fy": 0.0}, r"fy: must be greater than or equal to 0\.000001, got 0"),
        ({**FOCAL, "fx": 1e-300}, r"fx: must be greater than or equal to 0\.000001, got 1e-300"),
        ({**FOCAL, "cx": 1e200}, r"cx: must be less than or equal to 1000000000, got 1e\+200"),
        ({"fov_y_deg": 50, "resolution": (0, 480)}, r"resolution\[0\]: must be greater than or equal to 1"),
        ({"fov_y_deg": 50, "resolution": (640.5, 480)}, r"resolution\[0\]: must be an integer, got 640.5"),
        ({"fov_y_deg": 50, "resolution": (640, 10**6)}, "resolution: makes 6.40e.8 rays, expected at most 67108864"),
        ({"fov_y_deg": 50, "resolution": 640}, "resolution: must be a list, got 640"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        camera(**arguments)
