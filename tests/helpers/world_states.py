"""A model with geoms of many kinds, sensors of every kind and with every effect, and random states of the model."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from small_scenes import ASSETS

from rigcast import (
    Beam,
    DepthCamera,
    Detection,
    Filter,
    Frame,
    HeightScan,
    Lidar,
    Mount,
    Noise,
    Prop,
    Rig,
    Stereo,
    TimeOfFlight,
    Weather,
    Worlds,
)
from rigcast.sensors.specs.lidars.rosette import Rosette, Wedge

COUNT = 4
"""Worlds of a batch, where a test says nothing else."""
ON_EACH = pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
XML = f"""
<mujoco>
  <asset>{ASSETS}
    <material name="glass" rgba="0.2 0.8 0.3 0.4"/>
    <material name="steel" rgba="0.9 0.9 0.9 1" reflectance="0.7"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <geom name="hill" type="hfield" hfield="hill" pos="3 2 0"/>
    <geom name="pane" type="box" size="0.02 1 1" pos="1.5 -1 1" material="glass"/>
    <geom name="plate" type="box" size="0.02 1 1" pos="-3 0 1" euler="0 20 30" material="steel"/>
    <body name="robot" pos="0 0 1">
      <freejoint/>
      <geom name="robot" size="0.1"/>
      <site name="nose" pos="0.1 0 0.1" euler="0 10 0"/>
      <camera name="eye" pos="0.1 0 0" xyaxes="0 -1 0 0.3 0 1"/>
    </body>
    <body name="ball" pos="2 0 1"><freejoint/><geom name="ball" type="ellipsoid" size="0.3 0.4 0.5"/></body>
    <body name="tent" pos="0 2 1"><freejoint/><geom name="tent" type="mesh" mesh="tent"/></body>
    <body name="can" pos="-1 -2 1"><freejoint/><geom name="can" type="cylinder" size="0.3 0.5"/></body>
  </worldbody>
</mujoco>
"""
FIELDS = (
    *("range", "normal", "geom_id", "prop_id", "body_id", "points", "points_world", "stamp", "intensity"),
    *("depth", "depth_16bit", "ring", "column"),
)
_UNSEEN: dict[str, Any] = {"filter": Filter(exclude_bodies=["robot"])}
_EYE: dict[str, Any] = {"mount": Mount(camera="eye"), "resolution": (12, 9), "fov_y_deg": 60.0, **_UNSEEN}
_TOP: dict[str, Any] = {"elevation_deg": [-20, -5, 3], "columns": 24, "max_range": 30.0, **_UNSEEN}
_GRID: dict[str, Any] = {"mount": Mount(body="robot"), "size": (1.0, 0.6), "spacing": 0.1, **_UNSEEN}
SENSORS: dict[str, Lidar | DepthCamera | HeightScan] = {
    "lidar": Lidar(name="lidar", mount=Mount(body="robot", pos=(0, 0, 0.1), euler_deg=(3, 4, 5)), rate_hz=10, **_TOP),
    "fixed": Lidar(name="fixed", mount=Mount(pos=(0, 0, 3), euler_deg=(0, 30, 0)), **_TOP),
    "moving": Lidar(name="moving", mount=Mount(body="robot"), rate_hz=10, motion=True, **_TOP),
    "ring": Lidar(name="ring", mount=Mount(body="robot"), origin_radius=0.05, **_TOP),
    "rosette": Lidar(
        name="rosette",
        mount=Mount(body="robot"),
        rate_hz=100,
        rosette=Rosette(
            wedges=[
                Wedge(rpm=7294, tilt_deg=-18, index=1.5089, tilted_first=False),
                Wedge(rpm=-4664, tilt_deg=18, index=1.5089, tilted_first=True),
            ],
            sample_rate_hz=5000,
        ),
        **_UNSEEN,
    ),
    "scan": HeightScan(name="scan", **_GRID),
    "tilted": HeightScan(name="tilted", alignment="base", **_GRID),
    "level": HeightScan(name="level", alignment="world", **_GRID),
    "camera": DepthCamera(name="camera", **_EYE),
    "rolling": DepthCamera(name="rolling", readout_time=0.01, **_EYE),
    "noisy": Lidar(
        name="noisy",
        mount=Mount(site="nose"),
        noise=Noise(range_std=0.02, angle_std_deg=0.2, dropout=0.1),
        returns="dual",
        **_TOP,
    ),
    "weather": Lidar(
        name="weather",
        mount=Mount(site="nose", euler_deg=(0, 0, 90)),
        beam=Beam(divergence_deg=(0.5, 0.5), rings=1),
        detection=Detection(range=20.0, accuracy=0.02, accuracy_range=10.0),
        weather=Weather(rain_rate=20.0, visibility=200.0),
        max_surfaces=3,
        mirrors=True,
        **_TOP,
    ),
    "stereo": DepthCamera(
        name="stereo",
        stereo=Stereo(baseline=0.05, disparity_std=0.1, shadow=True, matching_window=3, dropout=0.1),
        **_EYE,
    ),
    "kinect": DepthCamera(name="kinect", stereo=Stereo(baseline=0.075, kinect_v1="nguyen"), **_EYE),
    "flight": DepthCamera(
        name="flight", time_of_flight=TimeOfFlight(range_std=0.01, subrays=2, modulation_hz=50e6), **_EYE
    ),
}


def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def states(model: mujoco.MjModel, count: int, seed: int = 0) -> list[mujoco.MjData]:
    """`count` states, with every free body at a random pose in each."""
    rng = np.random.default_rng(seed)
    datas = []
    for k in range(count):
        data = mujoco.MjData(model)
        data.qpos[:] = rng.normal(size=model.nq) + np.tile([0, 0, 1.5, 0, 0, 0, 0], model.nq // 7)
        data.time = 0.1 * k
        mujoco.mj_forward(model, data)
        datas.append(data)
    return datas


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """A copy of the state in new data of this model."""
    same = mujoco.MjData(model)
    same.qpos[:], same.time = data.qpos, data.time
    mujoco.mj_forward(model, same)
    return same


def arrays_of(datas: list[mujoco.MjData], names: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Arrays (worlds, ...) of the fields of many states, by MuJoCo's names; the default are poses and times."""
    names = names or (
        "geom_xpos",
        "geom_xmat",
        "xpos",
        "xmat",
        "site_xpos",
        "site_xmat",
        "cam_xpos",
        "cam_xmat",
        "time",
    )
    return {name: np.array([getattr(data, name) for data in datas]) for name in names}


def on_device(datas: list[mujoco.MjData], device: str = "cpu") -> Any:
    """Poses and times of many states as Warp arrays of vectors and matrices, in float64."""
    arrays = arrays_of(datas)
    kinds = {name: wp.mat33d if name.endswith("xmat") else wp.vec3d for name in arrays} | {"time": wp.float64}
    shaped = {name: v.reshape(*v.shape[:2], 3, 3) if name.endswith("xmat") else v for name, v in arrays.items()}
    return {name: wp.array(values, dtype=kinds[name], device=device) for name, values in shaped.items()}


def rig_of(model: mujoco.MjModel, *names: str, props: tuple[Prop, ...] = (), device: str = "cpu") -> Rig:
    return Rig(model, [SENSORS[name] for name in names or SENSORS], device, seed=5, props=props)


def alone(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    world: int,
    *names: str,
    props: tuple[Prop, ...] = (),
    device: str = "cpu",
) -> dict[str, Frame]:
    """The frames of a new rig in one world alone, with the random numbers of that world in a batch."""
    worlds = Worlds([state_of(model, data)], ids=[world])
    frames = rig_of(model, *names, props=props, device=device).sense(worlds)
    return {name: frame.world(0) for name, frame in frames.items()}


def fields_of(frame: Frame) -> dict[str, Any]:
    """All fields of a frame as numpy arrays."""
    values = {name: getattr(frame, name, None) for name in (*FIELDS, "time", "pose")}
    return {
        name: value.numpy() if isinstance(value, wp.array) else np.asarray(value)
        for name, value in values.items()
        if value is not None
    }


def assert_same(got: Frame, expected: Frame, where: str) -> None:
    """Assert that two frames have the same fields, each equal, NaN included."""
    a, b = fields_of(got), fields_of(expected)
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=f"{where}, {got.sensor}: {name}")
