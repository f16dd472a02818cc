"""Every sensor looks where it should: forward is forward, left is left and up is up."""

from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast import DepthCamera, Frame, HeightScan, Lidar, Mount, Rig
from rigcast.sensors.specs.mount import Alignment

# Marks around a sensor that looks along +x with +z up, in a body that is turned every way.
MARKS = {
    "ahead": (4, 0, 0),
    "left": (4, 1.5, 0),
    "right": (4, -1.5, 0),
    "up": (4, 0, 1.5),
    "down": (4, 0, -1.5),
    "far left": (0, 4, 0),
    "behind": (-4, 0, 0),
    "far right": (0, -4, 0),
    "high left": (0, 4, 2),
    "low left": (0, 4, -2),
}
# The MJCF camera, which looks along its -z with +y up, looks along the body's +x.
XML = """
<mujoco>
  <worldbody>
    <body name="robot" pos="3 -2 5">
      <freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <site name="site"/>
      <camera name="eye" xyaxes="0 -1 0 0 0 1" fovy="60" resolution="64 48"/>
      <body name="mast" pos="0.2 0.1 0.5" euler="10 20 30"><site name="mast"/></body>
      {}
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    marks = "".join(f'<geom name="{name}" size="0.4" pos="{x} {y} {z}" mass="0"/>' for name, (x, y, z) in MARKS.items())
    return mujoco.MjModel.from_xml_string(XML.format(marks))


def turned(model: mujoco.MjModel, seed: int) -> mujoco.MjData:
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    data.qpos[:] = rng.normal(size=7)
    data.qpos[3:] /= np.linalg.norm(data.qpos[3:])
    return data


def mount_on(kind: str, model: mujoco.MjModel, data: mujoco.MjData) -> Mount:
    """Return a mount on a carrier of this kind, at the robot's pose."""
    now = mujoco.MjData(model)
    now.qpos[:] = data.qpos
    mujoco.mj_kinematics(model, now)
    robot, mast = now.body("robot"), now.body("mast")
    back = mast.xmat.reshape(3, 3).T
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, (back @ robot.xmat.reshape(3, 3)).ravel())
    offset: dict[str, Any] = {"pos": back @ (robot.xpos - mast.xpos), "quat": quat}
    return {
        "body": Mount(body="robot"),
        "site": Mount(site="site"),
        "camera": Mount(camera="eye"),
        "body with offset": Mount(body="mast", **offset),
        "site with offset": Mount(site="mast", **offset),
        "world": Mount(pos=robot.xpos, quat=robot.xquat),
    }[kind]


KINDS = ["body", "site", "camera", "body with offset", "site with offset", "world"]


def centre_of(frame: Frame, model: mujoco.MjModel, mark: str) -> NDArray[np.float64]:
    """Mean row and column at which a mark is seen."""
    seen = np.argwhere(frame.geom_id.numpy() == model.geom(mark).id)
    assert len(seen) > 0, f"{mark} is not seen"
    return seen.mean(axis=0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_camera_sees_left_on_the_left_and_up_above(model: mujoco.MjModel, kind: str) -> None:
    for seed in range(3):
        data = turned(model, seed)
        camera = DepthCamera(name="c", mount=mount_on(kind, model, data), resolution=(64, 48), fov_y_deg=60.0)
        frame = Rig(model, [camera]).sense(data)["c"]
        offset = 1.5 / 4 * 24 / np.tan(np.deg2rad(30))  # pixels from the middle at which the outer marks are
        for mark, down, right in (("ahead", 0, 0), ("left", 0, -1), ("right", 0, 1), ("up", -1, 0), ("down", 1, 0)):
            expected = [23.5 + down * offset, 31.5 + right * offset]
            np.testing.assert_allclose(
                centre_of(frame, model, mark), expected, atol=0.7, err_msg=f"{mark}, seed {seed}"
            )
        assert not np.isin(frame.geom_id.numpy(), [model.geom("behind").id, model.geom("far left").id]).any()


def test_an_mjcf_cameras_own_optics_see_the_same(model: mujoco.MjModel) -> None:
    data = turned(model, 5)
    own = DepthCamera(name="own", mount=Mount(camera="eye"))
    given = DepthCamera(name="given", mount=Mount(body="robot"), resolution=(64, 48), fov_y_deg=60.0)
    frames = Rig(model, [own, given]).sense(data)
    np.testing.assert_array_equal(frames["own"].geom_id.numpy(), frames["given"].geom_id.numpy())
    np.testing.assert_allclose(frames["own"].range.numpy(), frames["given"].range.numpy(), rtol=1e-5)


@pytest.mark.parametrize("xyaxes", ["1 0 0 0 1 0", "0 -1 0 0 0 1", "0.3 0.5 -0.2 -0.4 0.6 0.9"])
def test_a_camera_looks_along_the_minus_z_of_its_mjcf_camera(xyaxes: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><camera name="eye" pos="1 2 3" xyaxes="{xyaxes}"/>
        <body name="target" mocap="true"><geom name="target" size="0.2"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    right, up, back = data.cam("eye").xmat.reshape(3, 3).T
    rig = Rig(model, [DepthCamera(name="c", mount=Mount(camera="eye"), resolution=(41, 31), fov_y_deg=70.0)])
    for across, above in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1)):
        data.mocap_pos[0] = data.cam("eye").xpos - 5 * back + across * right + above * up
        frame = rig.sense(data)["c"]
        focal = 15.5 / np.tan(np.deg2rad(35))
        expected = [15 - above / 5 * focal, 20 + across / 5 * focal]
        np.testing.assert_allclose(centre_of(frame, model, "target"), expected, atol=0.5)
        np.testing.assert_allclose(frame.pose[:3, :3], np.stack([right, -up, -back], axis=1), atol=1e-12)
        depth = frame.depth.numpy()
        assert np.nanmin(depth[np.isfinite(depth)]) == pytest.approx(4.8, abs=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_lidar_starts_ahead_and_turns_counter_clockwise_rows_as_listed(model: mujoco.MjModel, kind: str) -> None:
    for seed in range(3):
        data = turned(model, seed)
        steep = float(np.rad2deg(np.arctan2(2, 4)))
        lidar = Lidar(name="l", mount=mount_on(kind, model, data), elevation_deg=[-steep, 0, steep], columns=4)
        seen = Rig(model, [lidar]).sense(data)["l"].geom_id.numpy()
        names = [[model.geom(geom).name if geom >= 0 else "" for geom in row] for row in seen.tolist()]
        assert names == [
            ["", "low left", "", ""],
            ["ahead", "far left", "behind", "far right"],
            ["", "high left", "", ""],
        ], f"seed {seed}"


GROUND = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="robot"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    <body name="step" mocap="true"><geom name="step" type="box" size="0.05 0.05 0.25"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("roll_pitch", [(0, 0), (20, 0), (0, -35), (-50, 60)], ids=str)
@pytest.mark.parametrize("yaw", [0, 40, -130])
def test_a_height_scan_turns_but_does_not_tilt(roll_pitch: tuple[float, float], yaw: float) -> None:
    model = mujoco.MjModel.from_xml_string(GROUND)
    data = mujoco.MjData(model)
    attitude = Mount(euler_deg=(*roll_pitch, yaw)).offset[:3, :3]
    data.qpos[:3] = (2, -1, 1.5)
    mujoco.mju_mat2Quat(data.qpos[3:], attitude.ravel())
    turn = Mount(euler_deg=(0, 0, yaw)).offset[:3, :3]
    data.mocap_pos[0] = turn @ (0.4, 0.2, 0) + (2, -1, 0)  # under the ray at x 0.4, y 0.2 of the scan
    rig = Rig(model, [HeightScan(name="h", mount=Mount(body="robot"), size=(0.8, 0.4), spacing=0.2)])
    frame = rig.sense(data)["h"]
    x, y = (grid.ravel() for grid in np.meshgrid([-0.4, -0.2, 0, 0.2, 0.4], [-0.2, 0, 0.2]))
    height = np.where((x > 0.3) & (y > 0.1), 0.25, 0)
    np.testing.assert_allclose(frame.range.numpy(), 1.5 - height, atol=1e-6)
    expected = np.stack([x, y, np.zeros(15)], axis=-1) @ turn.T + (2, -1, 0)
    expected[:, 2] = height
    np.testing.assert_allclose(frame.points_world.numpy(), expected, atol=1e-6)
    np.testing.assert_allclose(frame.pose[:3, :3], turn, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_height_scan_is_aligned_as_it_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(GROUND)
    data = mujoco.MjData(model)
    data.qpos[:3], data.mocap_pos[0] = rng.uniform((-1, -1, 2), (1, 1, 3)), rng.uniform(-0.3, 0.3, 3)
    attitude = Mount(euler_deg=rng.uniform((-50, -50, -180), (50, 50, 180))).offset[:3, :3]
    mujoco.mju_mat2Quat(data.qpos[3:], attitude.ravel())
    mujoco.mj_kinematics(model, data)
    heading = np.rad2deg(np.arctan2(attitude[1, 0], attitude[0, 0]))
    level = Mount(euler_deg=(0, 0, heading)).offset[:3, :3]
    rotations: dict[Alignment, NDArray[np.float64]] = {"base": attitude, "yaw": level, "world": np.eye(3)}
    grid: dict[str, Any] = {"mount": Mount(body="robot"), "size": (2, 1), "spacing": 0.25}
    rig = Rig(model, [HeightScan(name=alignment, alignment=alignment, **grid) for alignment in rotations])
    frames = rig.sense(data)
    for alignment, rotation in rotations.items():
        frame, spec = frames[alignment], next(spec for spec in rig.sensors if spec.name == alignment)
        np.testing.assert_allclose(frame.pose[:3, :3], rotation, atol=1e-12, err_msg=f"{alignment}, seed {seed}")
        local = spec.pattern(model).origins
        assert local is not None
        starts, down = local @ rotation.T + data.qpos[:3], rotation @ (0, 0, -1.0)
        geom = np.zeros(1, np.int32)
        distance = [mujoco.mj_ray(model, data, start, down, None, 1, -1, geom) for start in starts]
        message = f"{alignment}, seed {seed}"
        np.testing.assert_allclose(frame.range.numpy(), distance, rtol=1e-5, err_msg=message)
        np.testing.assert_allclose(
            frame.points_world.numpy(), starts + np.outer(distance, down), atol=1e-5, err_msg=message
        )


# A robot without geoms, so that only its sensors are lost with its pose.
LOST = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <geom type="sphere" size="50"/>
    <body name="robot" pos="0 0 2">
      <freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="arm"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><camera name="eye"/></body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("joint", range(8))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_sensor_pose_that_is_not_finite_gives_a_frame_of_nan(joint: int, value: float) -> None:
    model = mujoco.MjModel.from_xml_string(LOST)
    on_arm: list[Lidar | DepthCamera | HeightScan] = [
        Lidar(name="lidar", mount=Mount(body="arm"), elevation_deg=[-10, 10], columns=8, min_range=1.0),
        DepthCamera(name="camera", mount=Mount(camera="eye"), resolution=(4, 3), max_range=100.0),
        HeightScan(name="scan", mount=Mount(body="arm"), size=(1, 1), spacing=0.5),
    ]
    well = Lidar(name="well", mount=Mount(pos=(0, 0, 1)), elevation_deg=[-10, 10], columns=8)
    rig, data = Rig(model, [*on_arm, well]), mujoco.MjData(model)
    before = {name: frame.range.numpy() for name, frame in rig.sense(data).items()}
    good, data.qpos[joint] = data.qpos[joint], value
    frames = rig.sense(data)
    for spec in on_arm:
        frame = frames[spec.name]
        assert frame.range.numpy().shape == before[spec.name].shape
        for field in ("range", "points", "points_world", *(("depth",) if spec.name == "camera" else ())):
            assert np.isnan(getattr(frame, field).numpy()).all(), f"{spec.name} {field}"
        assert (frame.geom_id.numpy() == -1).all()
        assert (frame.body_id.numpy() == -1).all()
        assert (frame.normal.numpy() == 0).all()
    data.qpos[joint] = good
    for name, after in {"well": frames["well"], **rig.sense(data)}.items():
        assert np.isfinite(before[name]).any(), name
        np.testing.assert_array_equal(after.range.numpy(), before[name], err_msg=name)
