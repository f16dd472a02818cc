"""Faults that were found in other ray casters, one test each."""

from typing import Any

import mujoco
import numpy as np
import pytest
from judged_casts import assert_none_wrong, placed
from lidar_scenes import model_of

import rigcast
from rigcast import CameraFrame, DepthCamera, Filter, Lidar, Mount, Rig

CUBE = 'vertex="-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"'
Vector = tuple[float, float, float]


def distances(model: mujoco.MjModel, origin: Vector, directions: list[Vector]) -> list[float]:
    """Return the distances that a scene casts, after asserting that mj_ray agrees with every hit."""
    _, data, scene = placed(model)
    hits = scene.cast(origin, directions).numpy()
    assert_none_wrong(model, data, origin, directions, hits)
    return list(hits.distance.tolist())


def lidar(**given: Any) -> Lidar:
    """Return a lidar with beams forward, left, back and right, in that order."""
    keys: dict[str, Any] = {"name": "lidar", "mount": Mount(), "elevation_deg": [0.0], "columns": 4}
    return Lidar(**{**keys, **given})


@pytest.mark.parametrize("far", [1.5, 999.0, 1500.0, 1e5])
def test_an_infinite_plane_is_seen_at_any_distance(far: float) -> None:
    model = model_of('<geom type="plane" size="0 0 1"/><geom type="sphere" size=".1" pos="0 0 -9"/>')
    assert distances(model, (0, 0, far), [(0, 0, -1)]) == pytest.approx([far], rel=1e-6)
    slant = (far, 0.5 * far, -1.0)
    assert distances(model, (0, 0, 1), [slant]) == pytest.approx([np.linalg.norm(slant)], rel=1e-6)


@pytest.mark.parametrize(("kind", "end"), [("capsule", 0.75), ("cylinder", 0.5)])
def test_the_second_size_of_a_capsule_or_cylinder_is_its_half_length(kind: str, end: float) -> None:
    model = model_of(f'<geom type="{kind}" size=".25 .5"/>')
    assert distances(model, (0, 0, 4), [(0, 0, -1)]) == pytest.approx([4 - end])
    assert distances(model, (4, 0, 0.49), [(-1, 0, 0)]) == pytest.approx([3.75])


@pytest.mark.parametrize(("geom", "out"), [('type="sphere" size="2"', 2), ('type="box" size="2 1 1"', 2)])
def test_a_sensor_inside_a_solid_reads_its_far_side_and_not_0(geom: str, out: float) -> None:
    model = model_of(f"<geom {geom}/>")
    assert distances(model, (0.5, 0, 0), [(1, 0, 0), (-1, 0, 0)]) == pytest.approx([out - 0.5, out + 0.5])
    (frame,) = Rig(model, [lidar()]).sense(mujoco.MjData(model)).values()
    assert frame.range.numpy()[0, 0] == pytest.approx(out)


@pytest.mark.parametrize("length", [1e-3, 0.1, 1.0, 7.0, 1e3])
def test_a_mesh_is_hit_whatever_the_length_of_the_direction(length: float) -> None:
    model = model_of('<geom type="mesh" mesh="cube"/>', f'<mesh name="cube" {CUBE}/>')
    assert distances(model, (-5, 0.1, 0.2), [(length, 0, 0)]) == pytest.approx([4])


def test_a_sensor_inside_a_mesh_sees_it() -> None:
    model = model_of('<geom type="mesh" mesh="cube"/>', f'<mesh name="cube" {CUBE}/>')
    assert distances(model, (0.5, 0.1, 0.2), [(1, 0, 0), (-1, 0, 0)]) == pytest.approx([0.5, 1.5])


HILL = '<hfield name="hill" nrow="3" ncol="3" elevation="0 0 0 0 1 0 0 0 0" size="1 1 .5 .25"/>'


@pytest.mark.parametrize(
    ("origin", "direction", "distance"),
    [
        pytest.param((-3, 0.2, -0.1), (1, 0, 0), 2.0, id="side -x"),
        pytest.param((3, 0.2, -0.1), (-1, 0, 0), 2.0, id="side +x"),
        pytest.param((0.2, -3, -0.1), (0, 1, 0), 2.0, id="side -y"),
        pytest.param((0.2, 3, -0.1), (0, -1, 0), 2.0, id="side +y"),
        pytest.param((0.3, 0.2, -3), (0, 0, 1), 2.75, id="underside"),
        pytest.param((0.3, 0.2, -0.1), (0, 0, 1), 0.1, id="base box from within"),
        pytest.param((0, 0, 3), (0, 0, -1), 2.5, id="top"),
        pytest.param((-3, 0.2, 0.01), (1, 0, 0), 2.02 + 0.2, id="no border above the terrain's own"),
        pytest.param((1.01, 0.2, 3), (0, 0, -1), np.inf, id="nothing beyond the border"),
        pytest.param((-3, 0.2, 0.6), (1, 0, 0), np.inf, id="nothing above the top"),
    ],
)
def test_a_height_field_has_a_surface_sides_a_base_and_no_more(
    origin: Vector, direction: Vector, distance: float
) -> None:
    model = model_of('<geom type="hfield" hfield="hill"/>', HILL)
    assert distances(model, origin, [direction]) == pytest.approx([distance], abs=1e-5)


BALL = '<geom name="ball" type="sphere" size="1"/>'
SPECIAL = {
    "cloth": f"""<worldbody>{BALL}
      <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".2 .2 .2" pos="0 0 2" radius=".01" dim="2"/>
    </worldbody>""",
    "coat": f"""<worldbody>{BALL}</worldbody><deformable>
      <skin name="coat" vertex="-1 -1 2  1 -1 2  0 1 2" face="0 1 2">
        <bone body="world" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/>
      </skin></deformable>""",
    "ring": f"""<extension><plugin plugin="mujoco.sdf.torus"><instance name="torus"/></plugin></extension>
      <asset><mesh name="torus"><plugin instance="torus"/></mesh></asset>
      <worldbody>{BALL}
        <geom type="sdf" name="ring" pos="0.3 0 2" mesh="torus"><plugin instance="torus"/></geom>
      </worldbody>""",
}


@pytest.mark.parametrize(("name", "field"), [("cloth", "flex_id"), ("coat", "skin_id"), ("ring", "geom_id")])
def test_flex_skin_and_sdf_are_hit(name: str, field: str) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{SPECIAL[name]}</mujoco>")
    scene = rigcast.Scene(model)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene.update(data)
    hits = scene.cast((0.05, 0.05, 4), (0, 0, -1)).numpy()
    assert getattr(hits, field) == (model.geom("ring").id if name == "ring" else 0)
    assert 1.8 < hits.distance < 2.05


def test_visual_only_geoms_are_seen() -> None:
    see = '<geom type="sphere" size=".5" contype="0" conaffinity="0"/>'
    model = model_of(f'<body pos="3 0 0"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{see}</body>')
    assert distances(model, (0, 0, 0), [(1, 0, 0)]) == pytest.approx([2.5])


MOVER = """<geom name="wall" type="box" size=".1 5 5" pos="4 0 0"/>
<body name="mover" pos="2 0 0"><joint name="slide" type="slide" axis="0 1 0"/><geom type="box" size=".1 1
1"/></body>"""


def test_a_moving_body_is_seen_where_it_is_without_a_call_of_the_users() -> None:
    model = model_of(MOVER)
    data = mujoco.MjData(model)
    rig = Rig(model, [lidar()])
    for offset, expected in ((0, 1.9), (3, 3.9), (-0.5, 1.9), (-3, 3.9)):
        data.qpos[0] = offset  # and no mj_forward: the rig recomputes the poses
        before = data.geom_xpos.copy()
        assert rig.sense(data)["lidar"].range.numpy()[0, 0] == pytest.approx(expected), f"at {offset} m"
        np.testing.assert_array_equal(data.geom_xpos, before)


def test_a_miss_is_inf_and_never_0_or_clipped_or_the_last_frames_point() -> None:
    model = model_of(MOVER)
    data = mujoco.MjData(model)
    rig = Rig(model, [lidar(max_range=3.0)])
    hit = rig.sense(data)["lidar"]
    data.qpos[0] = 3
    miss = rig.sense(data)["lidar"]
    assert hit.range.numpy()[0].tolist() == [pytest.approx(1.9), *3 * [np.inf]]
    assert np.isposinf(miss.range.numpy()).all()
    for field in (miss.points, miss.points_world):
        assert np.isnan(field.numpy()).all()
    assert (miss.normal.numpy() == 0).all()
    assert (miss.geom_id.numpy() == -1).all()
    assert (miss.body_id.numpy() == -1).all()
    assert np.isfinite(hit.points.numpy()[0, 0]).all()  # a frame owns its arrays


def seen_by(model: mujoco.MjModel, **given: Any) -> CameraFrame:
    """Return what a camera of 8 x 6 pixels at the world's origin reads."""
    keys: dict[str, Any] = {"name": "eye", "mount": Mount(), "resolution": (8, 6)}
    frame = Rig(model, [DepthCamera(**{**keys, **given})]).sense(mujoco.MjData(model))["eye"]
    assert isinstance(frame, CameraFrame)
    return frame


def test_depth_is_along_the_optical_axis_in_metres_and_range_is_euclidean() -> None:
    model = model_of('<geom name="wall" type="box" size="1 50 50" pos="13 0 0"/>')
    frame = seen_by(model, fov_y_deg=90.0)
    np.testing.assert_allclose(frame.depth.numpy(), np.full((6, 8), 12.0), rtol=1e-6)
    u, v = np.meshgrid((np.arange(8) + 0.5 - 4) / 3, (np.arange(6) + 0.5 - 3) / 3)
    np.testing.assert_allclose(frame.range.numpy(), 12 * np.sqrt(1 + u**2 + v**2), rtol=1e-6)
    np.testing.assert_allclose(frame.points.numpy(), 12 * np.stack([u, v, np.ones_like(u)], -1), atol=1e-5)


def test_a_camera_that_sees_nothing_has_infinite_depth() -> None:
    model = model_of('<geom name="behind" type="box" size="1 50 50" pos="-13 0 0"/>')
    frame = seen_by(model, fov_y_deg=90.0)
    assert np.isposinf(frame.depth.numpy()).all()
    assert np.isposinf(frame.range.numpy()).all()


def test_the_principal_point_is_where_the_optical_axis_meets_the_image() -> None:
    """A stick straight ahead is seen in the column and row of (cx, cy), wherever that is."""
    model = model_of('<geom type="sphere" size=".05" pos="10 0 0"/>')
    for cx, cy in ((4.5, 2.5), (1.5, 4.5)):
        frame = seen_by(model, fx=20.0, fy=20.0, cx=cx, cy=cy)
        assert np.argwhere(np.isfinite(frame.depth.numpy())).tolist() == [[int(cy), int(cx)]], f"{cx}, {cy}"


def test_an_mjcf_cameras_principal_point_is_an_offset_from_the_centre() -> None:
    """`principalpixel` is from the image's centre: (0, 0) looks straight ahead, not past a corner."""
    seen = {}
    for offset in ("0 0", "2 0", "0 2"):
        optics = f'resolution="9 7" sensorsize="9 7" focalpixel="20 20" principalpixel="{offset}"'
        world = f'<camera name="c" xyaxes="0 -1 0 0 0 1" {optics}/><geom type="sphere" size=".05" pos="10 0 0"/>'
        model = model_of(world)
        frame = seen_by(model, mount=Mount(camera="c"), resolution=None)
        seen[offset] = np.argwhere(np.isfinite(frame.depth.numpy())).tolist()
    assert seen["0 0"] == [[3, 4]]
    assert [abs(seen["2 0"][0][1] - 4), seen["2 0"][0][0]] == [2, 3]
    assert [abs(seen["0 2"][0][0] - 3), seen["0 2"][0][1]] == [2, 4]


def test_the_ground_is_seen_by_a_sensor_on_the_world() -> None:
    model = model_of('<geom type="plane" size="0 0 1"/>')
    down = lidar(mount=Mount(pos=(0, 0, 2)), elevation_deg=[-30.0])
    frame = Rig(model, [down]).sense(mujoco.MjData(model))["lidar"]
    np.testing.assert_allclose(frame.range.numpy(), np.full((1, 4), 4.0), rtol=1e-6)


ROBOT = """<geom name="wall" type="box" size=".1 9 9" pos="5 0 0"/>
<body name="base"><geom type="sphere" size=".2"/>
  <body name="arm" pos="1 0 0"><joint/><geom type="sphere" size=".2"/>
    <body name="hand" pos="1 0 0"><joint/><geom type="sphere" size=".2"/></body>
  </body>
</body>
<body name="guest" pos="3 0 0"><geom type="sphere" size=".2"/></body>"""


@pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")
@pytest.mark.parametrize(
    ("bodies", "subtree", "distance"),
    [
        ((), False, 0.2),
        (("base",), False, 0.8),
        (("base", "hand"), False, 0.8),
        (("base", "arm"), False, 1.8),
        (("base", "arm", "hand"), False, 2.8),
        (("base",), True, 2.8),
        (("base", "guest"), True, 4.9),
    ],
)
def test_a_robot_can_leave_out_all_of_itself(bodies: tuple[str, ...], subtree: bool, distance: float) -> None:
    own = Filter(exclude_bodies=bodies, exclude_subtree=subtree)
    rig = Rig(model_of(ROBOT), [lidar(mount=Mount(body="base"), filter=own)])
    frame = rig.sense(mujoco.MjData(rig.model))["lidar"]
    assert frame.range.numpy()[0, 0] == pytest.approx(distance)


@pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")
def test_two_sensors_on_one_scene_keep_their_own_filters() -> None:
    out = Filter(exclude_bodies=("base",), exclude_subtree=True)
    model = model_of(ROBOT)
    sensors = [lidar(mount=Mount(body="base")), lidar(name="out", mount=Mount(body="base"), filter=out)]
    frames = Rig(model, sensors).sense(mujoco.MjData(model))
    assert [frames[name].range.numpy()[0, 0] for name in ("lidar", "out")] == pytest.approx([0.2, 2.8])
