"""A rig that is reset gives the frames of a new rig, bit for bit."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast import DepthCamera, InputError, Lidar, Mount, Noise, Rig, Stereo

XML = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <geom type="box" size="0.1 4 2" pos="6 0 2"/>
    <body name="robot" pos="0 0 1"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  </worldbody>
</mujoco>
"""
MOUNT = Mount(body="robot")
ROWS: dict[str, Any] = {"mount": MOUNT, "elevation_deg": [-20, 0], "columns": 16, "noise": Noise(range_std=0.1)}
SENSORS: list[Lidar | DepthCamera] = [
    Lidar(name="plain", **ROWS),
    Lidar(name="late", rate_hz=30, latency=0.05, jitter=0.01, frame_loss=0.3, **ROWS),
    Lidar(name="sweeping", rate_hz=10, motion=True, **ROWS),
    Lidar(name="rosette", mount=MOUNT, preset="livox_mid40", rate_hz=40),
    DepthCamera(name="eye", mount=MOUNT, resolution=(8, 6), fov_y_deg=60, stereo=Stereo(baseline=0.1, disparity_std=1)),
]
Readings = list[tuple[str, Any, np.ndarray[Any, np.dtype[np.float32]]]]


def stepped(rig: Rig) -> Readings:
    data = mujoco.MjData(rig.model)
    frames = []
    while data.time < 0.33:  # a sweep is under way, and a frame has not come in
        mujoco.mj_step(rig.model, data)
        frames += rig.step(data)
    return [(frame.sensor, frame.time, frame.range.numpy()) for frame in frames]


def sensed(rig: Rig) -> Readings:
    data = mujoco.MjData(rig.model)
    frames = [frame for _ in range(3) for frame in rig.sense(data).values()]
    return [(frame.sensor, frame.time, frame.range.numpy()) for frame in frames]


def of_worlds(rig: Rig) -> Readings:
    worlds = [mujoco.MjData(rig.model) for _ in range(3)]
    for data in worlds:
        mujoco.mj_forward(rig.model, data)
    frames = [frame for _ in range(3) for frame in rig.sense(worlds).values()]
    return [(frame.sensor, 0.0, frame.range.numpy()) for frame in frames]


def same(one: Readings, other: Readings) -> bool:
    return len(one) == len(other) and all(
        a[:2] == b[:2] and np.array_equal(a[2], b[2], equal_nan=True) for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("read", [stepped, sensed, of_worlds])
def test_a_rig_that_is_reset_begins_anew(read: Callable[[Rig], Readings]) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    rig = Rig(model, SENSORS, seed=3)
    first = read(rig)
    assert not same(read(rig), first), "else there is nothing to reset"
    rig.reset()
    assert rig.seed == 3
    assert same(read(rig), first)
    rig.reset(4)
    assert rig.seed == 4
    other = read(rig)
    assert not same(other, first)
    assert same(other, read(Rig(model, SENSORS, seed=4)))


def test_a_rig_takes_a_seed_by_a_reset_only() -> None:
    rig = Rig(mujoco.MjModel.from_xml_string(XML), SENSORS, seed=3)
    with pytest.raises(AttributeError):
        rig.seed = 4  # type: ignore[misc]
    with pytest.raises(InputError, match="seed: got -1, expected a whole number from 0"):
        rig.reset(-1)
    assert rig.seed == 3
