"""`rigcast bench`: what it compares and the shape of what it writes; not how fast anything is."""

import json

import mujoco
import numpy as np

from rigcast import DepthCamera, Filter, Lidar, Mount, Rig
from rigcast.bench import bench
from rigcast.cli.bench import as_json
from rigcast.sensors.rig.mounted import Sensor

# The ball is seen by mj_ray alone: mj_multiRay looks for a body where its colliding geoms are, here above the ball.
MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <geom name="wall" type="box" size=".1 9 9" pos="5 0 0"/>
  <body name="ball" pos="2 0 0"><geom size=".1" pos="0 0 5"/>
    <geom type="sphere" size=".8" contype="0" conaffinity="0"/></body>
  <body name="robot"><geom type="sphere" size=".1"/></body>
</worldbody></mujoco>""")
OUTSIDE = Filter(exclude_bodies=("robot",))
SENSORS: list[Sensor] = [
    DepthCamera(name="eye", mount=Mount(), resolution=(12, 8), fov_y_deg=60.0, filter=OUTSIDE),
    Lidar(name="lidar", mount=Mount(), elevation_deg=[-5, 5], columns=30, filter=OUTSIDE),
]


def test_casters_are_compared_on_the_same_rays_and_rightness_is_shown() -> None:
    results = bench(Rig(MODEL, SENSORS), mujoco.MjData(MODEL), ("eye", "lidar"), rounds=2, sample=50)
    assert [(result.sensor, result.shape) for result in results] == [("eye", (8, 12)), ("lidar", (2, 30))]
    for result in results:
        assert [speed.caster for speed in result.speeds] == ["rigcast", "mj_multiRay", "mj_ray"]
        ours, multi, reference = result.speeds
        assert ours.agree == reference.agree == 1
        assert multi.agree < 1  # it sees no ball: fast by being wrong
        assert ours.ratio == 1
        for speed in result.speeds:
            assert 0 < speed.lowest <= speed.median <= speed.highest
            np.testing.assert_allclose(speed.ratio, ours.median / speed.median)


def test_json_has_the_speeds_and_what_they_were_measured_on() -> None:
    results = bench(Rig(MODEL, SENSORS), mujoco.MjData(MODEL), ("lidar",), rounds=1, sample=5)
    read = json.loads(as_json(results, "cpu", 1))
    assert set(read) == {"device", "cores", "machine", "rounds", "versions", "sensors"}
    assert set(read["versions"]) == {"rigcast", "mujoco", "warp-lang", "numpy"}
    (lidar,) = read["sensors"]
    assert (lidar["sensor"], lidar["shape"]) == ("lidar", [2, 30])
    assert set(lidar["speeds"][0]) == {"caster", "median", "lowest", "highest", "agree", "ratio"}
