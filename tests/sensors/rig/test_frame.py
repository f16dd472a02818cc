"""A frame's fields have the shapes, types, frames and miss values of the contract, and keep them."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from rigcast import CameraFrame, DepthCamera, Frame, HeightScan, Hits, Lidar, LidarFrame, Mount, Rig, Scene, Worlds

# A tilted robot above a floor and a hump: the ball before its sensors is too near, the tower and the sky too far.
XML = """
<mujoco>
  <option timestep="0.01"/>
  <asset>
    <hfield name="hump" nrow="3" ncol="3" size="1 1 0.5 0.1" elevation="0 0.1 0 0.2 1 0.3 0 0 0.2"/>
    <mesh name="wedge" vertex="-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  0 -1 1  0 1 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 1"/>
    <geom name="hump" type="hfield" hfield="hump" pos="1.5 2 0"/>
    <geom name="tower" type="box" size="1 40 40" pos="40 0 0"/>
    <body name="crate" pos="4 4 0">
      <geom name="wedge" type="mesh" mesh="wedge"/>
      <geom name="globe" size="0.5" pos="0 0 2"/>
    </body>
    <body name="robot" pos="1 2 1.5" euler="5 -10 40">
      <freejoint/>
      <geom name="ball" size="0.1" pos="0.4 0.05 -0.1" mass="1"/>
      <geom name="foot" size="0.1" pos="0 0.2 -0.4" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
BODY = Mount(body="robot", pos=(0.1, 0, 0))
LIMITS: dict[str, Any] = {"min_range": 0.5, "max_range": 20.0}
SENSORS: dict[str, Lidar | DepthCamera | HeightScan] = {
    "lidar": Lidar(name="lidar", mount=BODY, elevation_deg=[-40, -20, -15, 0, 30], columns=24, **LIMITS),
    "camera": DepthCamera(name="camera", mount=BODY, resolution=(9, 7), fov_y_deg=100.0, **LIMITS),
    "scan": HeightScan(name="scan", mount=Mount(body="robot"), size=(30.0, 1.0), spacing=0.1, **LIMITS),
}
SHAPES = {"lidar": (5, 24), "camera": (7, 9), "scan": (301 * 11,)}
PER_RAY: dict[str, tuple[type, tuple[int, ...]]] = {
    "range": (wp.float32, ()),
    "points": (wp.float32, (3,)),
    "points_world": (wp.float64, (3,)),
    "normal": (wp.float32, (3,)),
    "geom_id": (wp.int32, ()),
    "body_id": (wp.int32, ()),
    "stamp": (wp.float64, ()),
}
OWN = {
    "lidar": {"ring": (wp.int32, ()), "column": (wp.int32, ())},
    "camera": {"depth": (wp.float32, ())},
    "scan": {},
}
CASES = [(name, field) for name in SENSORS for field in (*PER_RAY, *OWN[name])]


@dataclass
class Reading:
    """A frame, its fields on the host, and the hits of its rays without range limits."""

    frame: Frame
    hits: Hits
    model: mujoco.MjModel

    def __getattr__(self, field: str) -> NDArray[Any]:
        return np.asarray(getattr(self.frame, field).numpy())

    @property
    def valid(self) -> NDArray[np.bool_]:
        return np.isfinite(self.range)

    def ends(self) -> NDArray[np.float64]:
        """Ends (n, 3) of the valid rays in the sensor's frame [m]: origin + range * direction."""
        pattern = SENSORS[self.frame.sensor].pattern(self.model)
        origins = np.zeros_like(pattern.directions) if pattern.origins is None else pattern.origins
        distance = self.range[self.valid, None].astype(np.float64)
        return np.asarray(origins[self.valid] + distance * pattern.directions[self.valid])


def at_start() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.time = 12.5
    return model, data


@pytest.fixture(scope="module")
def readings() -> dict[str, Reading]:
    model, data = at_start()
    rig = Rig(model, SENSORS.values())
    hits = rig.cast(data)
    return {name: Reading(frame, hits[name], model) for name, frame in rig.sense(data).items()}


@pytest.fixture(params=SENSORS)
def reading(request: pytest.FixtureRequest, readings: dict[str, Reading]) -> Reading:
    return readings[request.param]


@pytest.mark.parametrize(("name", "field"), CASES)
def test_field_has_its_shape_and_type(readings: dict[str, Reading], name: str, field: str) -> None:
    dtype, tail = {**PER_RAY, **OWN[name]}[field]
    array = getattr(readings[name].frame, field)
    assert (array.dtype, tuple(array.shape)) == (dtype, SHAPES[name] + tail)
    assert array.device == wp.get_preferred_device()


@pytest.mark.parametrize(("name", "kind"), [("lidar", LidarFrame), ("camera", CameraFrame), ("scan", Frame)])
def test_a_frame_says_whose_it_is_and_when(readings: dict[str, Reading], name: str, kind: type) -> None:
    frame = readings[name].frame
    assert type(frame) is kind
    assert (frame.sensor, frame.time) == (name, 12.5)
    assert isinstance(frame.time, float)
    assert frame.pose.shape == (4, 4)
    assert frame.pose.dtype == np.float64
    np.testing.assert_array_equal(frame.pose[3], [0, 0, 0, 1])
    np.testing.assert_allclose(frame.pose[:3, :3] @ frame.pose[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(readings[name].stamp, 12.5)


def test_range_is_the_distance_within_the_limits_and_infinite_outside(reading: Reading) -> None:
    distance = reading.hits.numpy().distance
    near, far = distance < LIMITS["min_range"], distance > LIMITS["max_range"]
    np.testing.assert_array_equal(reading.range, np.where(near, -np.inf, np.where(far, np.inf, distance)))
    # every state occurs, or the tests below prove little
    assert near.any()
    assert reading.valid.any()
    assert np.isinf(distance).any()
    assert (far & np.isfinite(distance)).any() or reading.frame.sensor != "lidar"


def test_where_range_is_not_finite_nothing_else_is_given(reading: Reading) -> None:
    lost = ~reading.valid
    assert np.isnan(reading.points[lost]).all()
    assert np.isnan(reading.points_world[lost]).all()
    assert (reading.geom_id[lost] == -1).all()
    assert (reading.body_id[lost] == -1).all()
    assert (reading.normal[lost] == 0).all()
    assert (reading.geom_id[reading.valid] >= 0).all()
    assert np.isfinite(reading.points[reading.valid]).all()


def test_points_lie_at_their_range_along_their_ray(reading: Reading) -> None:
    np.testing.assert_allclose(reading.points[reading.valid], reading.ends(), rtol=1e-6, atol=1e-6)


def test_points_world_are_points_under_the_pose(reading: Reading) -> None:
    rotation, position = reading.frame.pose[:3, :3], reading.frame.pose[:3, 3]
    world = reading.points_world[reading.valid]
    np.testing.assert_allclose(world, reading.ends() @ rotation.T + position, rtol=0, atol=1e-12)
    points = reading.points[reading.valid].astype(np.float64)
    np.testing.assert_allclose(world, points @ rotation.T + position, rtol=0, atol=1e-5)


def test_points_on_the_floor_are_on_the_floor(readings: dict[str, Reading]) -> None:
    for name, reading in readings.items():
        floor = reading.geom_id == reading.model.geom("floor").id
        assert floor.any(), name
        np.testing.assert_allclose(reading.points_world[floor][:, 2], 0, atol=2e-6, err_msg=name)


def test_normals_are_unit_and_in_the_frame_of_the_points(reading: Reading) -> None:
    world = reading.normal.astype(np.float64) @ reading.frame.pose[:3, :3].T
    np.testing.assert_allclose(world[reading.valid], reading.hits.numpy().normal[reading.valid], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(reading.normal[reading.valid], axis=-1), 1, atol=1e-6)
    floor = reading.geom_id == reading.model.geom("floor").id
    np.testing.assert_allclose(world[floor], np.tile([0, 0, 1], (floor.sum(), 1)), atol=1e-6)


def test_ids_are_mujocos(reading: Reading) -> None:
    np.testing.assert_array_equal(reading.geom_id[reading.valid], reading.hits.numpy().geom_id[reading.valid])
    expected = reading.model.geom_bodyid[reading.geom_id[reading.valid]]
    np.testing.assert_array_equal(reading.body_id[reading.valid], expected)
    assert len(np.unique(expected)) > 1


def test_ring_and_column_are_row_and_column(readings: dict[str, Reading]) -> None:
    rows, columns = np.indices(SHAPES["lidar"])
    np.testing.assert_array_equal(readings["lidar"].ring, rows)
    np.testing.assert_array_equal(readings["lidar"].column, columns)


def test_depth_is_z_and_infinite_where_range_is(readings: dict[str, Reading]) -> None:
    camera = readings["camera"]
    np.testing.assert_allclose(camera.depth[camera.valid], camera.points[camera.valid][:, 2], rtol=1e-6)
    np.testing.assert_array_equal(camera.depth[~camera.valid], camera.range[~camera.valid])
    assert (camera.depth[camera.valid] <= camera.range[camera.valid]).all()


def test_a_cameras_points_project_onto_their_pixels(readings: dict[str, Reading]) -> None:
    camera = readings["camera"]
    assert isinstance(camera.frame, CameraFrame)
    assert camera.frame.intrinsics.shape == (3, 3)
    assert camera.frame.intrinsics.dtype == np.float64
    rows, columns = np.nonzero(camera.valid)
    pixels = camera.points[camera.valid] @ camera.frame.intrinsics.T
    np.testing.assert_allclose(pixels[:, 0] / pixels[:, 2], columns + 0.5, atol=1e-4)
    np.testing.assert_allclose(pixels[:, 1] / pixels[:, 2], rows + 0.5, atol=1e-4)


BELOW, ABOVE = (float(np.nextafter(np.float32(2), np.float32(end))) for end in (0, 3))
AHEAD = """<mujoco><worldbody>
<geom type="box" size="1 1 1" pos="3 0 0"/><geom name="beyond" size="1" pos="9 0 0"/>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        pytest.param({"min_range": 2.0}, 2.0, id="at the minimum"),
        pytest.param({"min_range": ABOVE}, -np.inf, id="just below the minimum"),
        pytest.param({"max_range": 2.0}, 2.0, id="at the maximum"),
        pytest.param({"max_range": BELOW}, np.inf, id="just beyond the maximum"),
        pytest.param({"min_range": BELOW, "max_range": ABOVE}, 2.0, id="just within both"),
        pytest.param({}, 2.0, id="no limits"),
    ],
)
def test_range_limits_are_inclusive(limits: dict[str, Any], expected: float) -> None:
    model = mujoco.MjModel.from_xml_string(AHEAD)
    lidar = Lidar(name="lidar", mount=Mount(), elevation_deg=[0], columns=1, **limits)
    frame = Rig(model, [lidar]).sense(mujoco.MjData(model))["lidar"]
    assert frame.range.numpy().tolist() == [[expected]]
    assert frame.geom_id.numpy().tolist() == [[0 if np.isfinite(expected) else -1]]


@pytest.mark.parametrize(("name", "field"), CASES)
def test_a_field_asked_for_twice_is_the_same(readings: dict[str, Reading], name: str, field: str) -> None:
    frame = readings[name].frame
    first = getattr(frame, field).numpy().copy()
    np.testing.assert_array_equal(getattr(frame, field).numpy(), first)


@pytest.mark.parametrize("name", SENSORS)
def test_a_frame_keeps_its_values_after_later_steps(name: str) -> None:
    model, data = at_start()
    rig = Rig(model, SENSORS.values())
    asked, waiting = (rig.sense(data)[name] for _ in range(2))
    fields = (*PER_RAY, *OWN[name])
    before = {field: getattr(asked, field).numpy().copy() for field in fields}
    pose = asked.pose.copy()
    for _ in range(5):
        mujoco.mj_step(model, data, 3)
        later = [frame for frame in rig.step(data) if frame.sensor == name]
        rig.cast(data)
    assert not np.array_equal(later[0].range.numpy(), before["range"])
    for field in fields:
        np.testing.assert_array_equal(getattr(asked, field).numpy(), before[field], err_msg=f"{field} asked before")
        np.testing.assert_array_equal(getattr(waiting, field).numpy(), before[field], err_msg=f"{field} asked after")
    np.testing.assert_array_equal(asked.pose, pose)


def test_a_frame_in_a_terminal_says_what_it_is() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    rig = Rig(model, SENSORS.values(), "cpu")
    frame = rig.sense(mujoco.MjData(model))["lidar"]
    assert repr(frame) == "LidarFrame(sensor='lidar', time=0.0, shape=(5, 24))"
    assert repr(rig) == "Rig(lidar: lidar, camera: depth_camera, scan: height_scan; on cpu)"
    assert repr(rig.cast(mujoco.MjData(model))["lidar"]) == "Hits(shape=(5, 24))"


def test_a_scene_and_worlds_in_a_terminal_say_how_much_they_hold() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    scene = Scene(model, "cpu")
    assert repr(scene) == f"Scene(geoms: {model.ngeom}; on cpu)"
    worlds = Worlds([data] * 3)
    assert repr(worlds) == "Worlds(3)"
    scene.update(worlds)
    assert repr(scene) == f"Scene(geoms: {model.ngeom}, worlds: 3; on cpu)"
    assert repr(Scene(mujoco.MjModel.from_xml_string("<mujoco/>"), "cpu")) == "Scene(empty; on cpu)"
    sizes = np.tile(model.geom_size, (3, 1, 1))
    differing = Worlds([data] * 3, geom_size=sizes, mounts={"lidar": [Mount()] * 3}, active=[True] * 3)
    assert repr(differing) == "Worlds(3; geom_size, mounts, active)"
