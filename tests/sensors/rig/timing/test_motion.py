"""Readings with motion are those of a cast at each firing time in a simulation with a tiny timestep."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast import (
    Beam,
    CameraFrame,
    DepthCamera,
    Detection,
    Frame,
    InputError,
    Lidar,
    Mount,
    Noise,
    Rig,
    Stereo,
    TimeOfFlight,
)

# A sensor on a body that turns and slides, past a box that slides and turns, a mesh that tumbles, and a wall.
XML = """
<mujoco>
  <option timestep="{}" gravity="0 0 0"><flag contact="disable"/></option>
  <default><geom mass="1"/></default>
  <asset><mesh name="tent" vertex="-1 -1 0  1 -1 0  -1 1 0  1 1 0  0 -0.5 1  0.2 0.7 1.3"/></asset>
  <worldbody>
    <geom type="plane" size="0 0 1" pos="0 0 -1"/>
    <geom type="box" size="0.1 6 2" pos="5 0 0"/>
    <body name="robot" pos="0 0 0">
      <joint type="slide" axis="1 0 0"/><joint type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <site name="eye" pos="0.2 0.1 0.3"/>
    </body>
    <body pos="2 1 0"><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>
      <geom type="box" size="0.4 0.3 0.6"/></body>
    <body pos="-2 -1 0"><joint type="hinge" axis="1 0 0"/><geom type="mesh" mesh="tent"/></body>
    <body pos="0 -2.5 0"><joint type="slide" axis="1 0 0"/><geom type="capsule" size="0.3 0.4"/></body>
  </worldbody>
</mujoco>
"""
TURNING = (1.0, 2.0, -1.5, 3.0, 2.0, -2.0)  # [m/s] and [rad/s] of the joints
SPINNING: dict[str, Any] = {
    "mount": Mount(site="eye"),
    "elevation_deg": [-20, -8, -3, 4, 13],
    "columns": 512,
    "rate_hz": 10.0,
}
ROLLING: dict[str, Any] = {"mount": Mount(site="eye"), "resolution": (64, 48), "fov_y_deg": 70.0, "rate_hz": 25.0}
TIMESTEP = 0.004


def moving(timestep: float, velocity: tuple[float, ...] = TURNING) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(XML.format(timestep))
    data = mujoco.MjData(model)
    data.qvel[:] = velocity
    return model, data


def frames_of(*specs: Lidar | DepthCamera, timestep: float = TIMESTEP, until: float = 0.25) -> list[Frame]:
    """The frames that begin after time 0, at which the rig is stepped first."""
    model, data = moving(timestep)
    rig = Rig(model, specs, "cpu")
    rig.step(data)
    return [frame for _, frame in drive(rig, data, until) if frame.time > 0]


def drive(rig: Rig, data: mujoco.MjData, until: float) -> Iterator[tuple[float, Frame]]:
    """The frames, each with the time of the step that gave it."""
    while data.time < until - 1e-9:
        mujoco.mj_step(rig.model, data)
        for frame in rig.step(data):
            yield data.time, frame


def spinning(**arguments: Any) -> Lidar:
    return Lidar(**{"name": "eye", **SPINNING, "motion": True, **arguments})


def rolling(**arguments: Any) -> DepthCamera:
    return DepthCamera(**{"name": "eye", **ROLLING, "readout_time": 0.03, **arguments})


def expected_ranges(frame: Frame, spec: Lidar | DepthCamera, jolt: float = 0.0) -> NDArray[np.float64]:
    """Ranges by mj_ray, each at the time of its ray, in a simulation with a timestep of a hundredth.

    jolt: angle by which each ray is turned up and to the left [rad].
    """
    model, data = moving(TIMESTEP / 100)
    pattern = spec.pattern(model)
    mount = spec.mount.bind(model)
    stamps = frame.stamp.numpy().ravel()
    directions = pattern.directions.reshape(-1, 3) + jolt * np.array([0.3, 1.0, 0.7])
    origins = np.zeros_like(directions) if pattern.origins is None else pattern.origins.reshape(-1, 3)
    ranges, hit, now = np.empty(len(stamps)), np.empty(1, np.int32), mujoco.MjData(model)
    for ray in np.argsort(stamps, kind="stable"):
        while data.time + model.opt.timestep <= stamps[ray]:
            mujoco.mj_step(model, data)
        # the joints move at a steady pace, so that the rest of the way is exact
        now.qpos[:] = data.qpos + (stamps[ray] - data.time) * data.qvel
        mujoco.mj_kinematics(model, now)
        pose = mount.pose(now)
        pose[:3, :3] = pose[:3, :3] @ spec.frame_rotation
        origin, direction = pose[:3, 3] + pose[:3, :3] @ origins[ray], pose[:3, :3] @ directions[ray]
        distance = mujoco.mj_ray(model, now, origin, direction, None, 1, -1, hit)
        ranges[ray] = distance * np.linalg.norm(direction) if distance >= 0 else np.inf
    return ranges.reshape(frame.shape)


def assert_ranges(frame: Frame, spec: Lidar | DepthCamera, within: float = 1e-3, *, facing: bool = False) -> None:
    """Assert that ranges are as expected outside the edge band, where rays turned by 0.5 mrad meet other surfaces.

    facing: bound the distance of the point from the surface [m] in place of the error of the range.
    """
    got, expected = frame.range.numpy(), expected_ranges(frame, spec)
    aside = [expected_ranges(frame, spec, jolt) for jolt in (-5e-4, 5e-4)]
    with np.errstate(invalid="ignore"):
        at_edge = ~(np.abs(sum(aside) / 2 - expected) < 0.01)
        error = np.where(np.isinf(expected) & np.isinf(got), 0.0, np.abs(got - expected))
    at_edge &= np.isfinite(expected) | np.isfinite(aside).any(axis=0)
    assert at_edge.mean() < 0.05
    if facing:
        directions = spec.pattern(moving(TIMESTEP)[0]).directions
        error *= np.abs((frame.normal.numpy() * directions).sum(axis=-1))
    error = error[~at_edge]
    assert error.max() <= within, f"got {error.max()} m, at {(error > within).sum()} of {error.size} rays"


def test_a_spinning_lidar_on_a_turning_body_agrees_to_a_millimetre() -> None:
    """At 10 Hz and 2 rad/s past a moving box; without `motion` it does not agree."""
    spec = spinning()
    moved, still = (frames_of(each, until=0.2)[0] for each in (spec, spec.model_copy(update={"motion": False})))
    assert moved.time == still.time == pytest.approx(0.1)
    assert_ranges(moved, spec)
    with pytest.raises(AssertionError, match="got"):
        assert_ranges(still, spec, within=0.05)


@pytest.mark.parametrize("origin_height", [None, (0.01, 0.005, 0, -0.005, -0.01)])
def test_rows_that_fire_one_after_the_other_agree_too(origin_height: tuple[float, ...] | None) -> None:
    """With one origin, rays fired within 0.1 ms leave from one pose, in packets; else they are single."""
    table = {**{key: value for key, value in SPINNING.items() if key != "columns"}, "rate_hz": 20.0}
    times = (0, 9.2, 18.4, 27.6, 36.9)
    spec = Lidar(
        name="eye",
        **table,
        firing_time_us=times,
        origin_height=origin_height,
        column_period_us=55.3,
        motion=True,
    )
    assert_ranges(frames_of(spec, until=0.204)[0], spec, facing=True)


def test_a_rolling_shutter_agrees_to_a_millimetre() -> None:
    spec = rolling()
    frame = frames_of(spec, until=0.08)[0]
    assert frame.time == pytest.approx(0.04)
    assert_ranges(frame, spec)


def test_points_in_the_world_lie_where_things_are() -> None:
    """Wall and floor stand still while the sensor moves: each point is placed by the pose at its own ray's time."""
    frame = frames_of(spinning(), until=0.2)[0]
    points, geom = frame.points_world.numpy(), frame.geom_id.numpy()
    np.testing.assert_allclose(points[geom == 0][:, 2], -1, atol=1e-5)
    np.testing.assert_allclose(points[geom == 1][:, 0], 4.9, atol=1e-5)
    assert (geom == 1).sum() > 100
    # in the sensor's frame they are distorted as a driver's are, at the end by 0.2 rad
    local = np.concatenate([frame.points.numpy().reshape(-1, 3), np.ones((geom.size, 1))], axis=1)
    by_first_pose = (local @ frame.pose.T)[:, :3].reshape(points.shape)
    assert np.nanmax(np.abs(by_first_pose - points)) > 0.3
    first = np.unravel_index(frame.stamp.numpy().argmin(), frame.shape)
    np.testing.assert_allclose(by_first_pose[first], points[first], atol=1e-5)


def test_normals_are_in_the_frame_of_their_ray() -> None:
    frame = frames_of(spinning(), until=0.2)[0]
    wall = frame.geom_id.numpy() == 1
    turned = 2 * frame.stamp.numpy()[wall]
    expected = np.stack([-np.cos(turned), np.sin(turned), np.zeros_like(turned)], axis=1)
    np.testing.assert_allclose(frame.normal.numpy()[wall], expected, atol=1e-5)


@pytest.mark.parametrize("timestep", [0.001, 0.0037, 0.03, 0.15])
def test_readings_do_not_depend_on_the_timestep(timestep: float) -> None:
    """Steady motion differs only by chords; the numbers of rays, stamps and readings are the same."""
    specs = spinning(), rolling(name="rolling")
    fine, coarse = (frames_of(*specs, timestep=step, until=0.45) for step in (0.002, timestep))
    for name in ("eye", "rolling"):
        pairs = list(zip(*([f for f in each if f.sensor == name] for each in (fine, coarse)), strict=False))
        assert len(pairs) >= 3
        for a, b in pairs:
            assert a.shape == b.shape
            assert a.time == b.time
            np.testing.assert_array_equal(a.stamp.numpy(), b.stamp.numpy())
            allowed = 2e-3 + 20 * timestep**2
            assert np.isclose(a.range.numpy(), b.range.numpy(), rtol=0, atol=allowed).mean() > 0.95


def test_a_reading_comes_in_when_its_last_ray_is_fired() -> None:
    model, data = moving(TIMESTEP)
    late = spinning(name="late", latency=0.15)
    early = spinning(name="early", latency=0.05)
    camera = rolling(name="camera", rate_hz=None, readout_time=0.021)
    got = list(drive(Rig(model, [spinning(), late, early, camera], "cpu"), data, 0.5))
    last_ray = 511 / 5120
    for name, delay in (("eye", last_ray), ("late", 0.15), ("early", last_ray)):
        times = [(now, frame.time) for now, frame in got if frame.sensor == name]
        assert len(times) == int((0.5 - delay) * 10 + 1e-9)
        for now, time in times:
            assert time + delay - 1e-6 <= now < time + delay + TIMESTEP
    # several are under way at once, one from every step
    times = [(now, frame.time) for now, frame in got if frame.sensor == "camera"]
    np.testing.assert_allclose(np.diff([time for _, time in times]), TIMESTEP)
    assert all(time + 0.021 * 47 / 48 - 1e-6 <= now < time + 0.021 + TIMESTEP for now, time in times)


def test_a_reading_under_way_at_a_reset_is_discarded() -> None:
    model, data = moving(TIMESTEP)
    rig = Rig(model, [spinning()], "cpu")
    assert [frame.time for _, frame in drive(rig, data, 0.29)] == pytest.approx([0.1])
    mujoco.mj_resetData(model, data)
    data.qvel[:] = TURNING
    again = [frame for _, frame in drive(rig, data, 0.2)]
    assert [frame.time for frame in again] == pytest.approx([0.1])
    np.testing.assert_array_equal(again[0].range.numpy(), frames_of(spinning(), until=0.2)[0].range.numpy())


def test_a_single_reading_is_of_a_world_that_stands_still() -> None:
    model, data = moving(TIMESTEP)
    moved = Rig(model, [spinning(), rolling(name="rolling")], "cpu").sense(data)
    frozen = Rig(model, [spinning(motion=False), rolling(name="rolling", readout_time=0.0)], "cpu").sense(data)
    for name in ("eye", "rolling"):
        np.testing.assert_array_equal(moved[name].range.numpy(), frozen[name].range.numpy())
        np.testing.assert_array_equal(moved[name].normal.numpy(), frozen[name].normal.numpy())
        np.testing.assert_array_equal(moved[name].points_world.numpy(), frozen[name].points_world.numpy())


def test_sensors_that_move_do_not_change_those_that_do_not() -> None:
    frozen = spinning(name="frozen", motion=False)
    alone = frames_of(frozen)
    beside = [frame for frame in frames_of(spinning(), frozen, rolling(name="rolling")) if frame.sensor == "frozen"]
    assert len(alone) == len(beside) == 2
    for a, b in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(a.range.numpy(), b.range.numpy())


def test_steps_of_sensors_that_move_leave_the_scene_where_it_was() -> None:
    model, data = moving(TIMESTEP)
    rig = Rig(model, [spinning()], "cpu")
    rig.sense(data)
    rays = (0, 0, 0.5), np.random.default_rng(0).normal(size=(500, 3))
    before = rig.scene.cast(*rays).numpy().distance
    mujoco.mj_step(model, data, 10)
    assert not rig.step(data), "nothing is over yet"
    np.testing.assert_array_equal(rig.scene.cast(*rays).numpy().distance, before)


EFFECTS: dict[str, tuple[Lidar | DepthCamera, dict[str, Any]]] = {
    "lidar": (spinning(), {"detection": Detection(range=1e6)}),
    "angle": (spinning(), {"noise": Noise(angle_std_deg=1e-7)}),
    "beam": (spinning(), {"beam": Beam(divergence_deg=(1e-6, 1e-6), rings=1)}),
    "glass": (spinning(), {"max_surfaces": 2, "mirrors": True, "returns": "first"}),
    "shadow": (rolling(), {"stereo": Stereo(baseline=1e-7, shadow=True)}),
    "shift": (rolling(), {"stereo": Stereo(baseline=0.1, disparity_std=1e-9)}),
    "flight": (rolling(), {"time_of_flight": TimeOfFlight(range_std=1e-9)}),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_effects_too_small_to_see_change_nothing_in_motion(name: str) -> None:
    spec, options = EFFECTS[name]
    plain, disturbed = (frames_of(each, until=0.2)[0] for each in (spec, type(spec)(**{**dict(spec), **options})))
    close = np.isclose(plain.range.numpy(), disturbed.range.numpy(), atol=1e-3)
    assert close.mean() > 0.99
    same = close & np.isfinite(plain.range.numpy())
    np.testing.assert_allclose(plain.points_world.numpy()[same], disturbed.points_world.numpy()[same], atol=2e-3)
    np.testing.assert_allclose(plain.intensity.numpy()[same], disturbed.intensity.numpy()[same], atol=2e-3)


def test_subrays_are_seen_when_their_pixel_is() -> None:
    one, nine = (rolling(time_of_flight=TimeOfFlight(subrays=subrays)) for subrays in (1, 3))
    a, b = (frames_of(spec, until=0.08)[0].range.numpy() for spec in (one, nine))
    assert np.isclose(a, b, rtol=0, atol=5e-3).mean() > 0.9


def test_a_camera_cannot_read_longer_than_its_period() -> None:
    with pytest.raises(InputError, match=r"readout_time: must be at most 1 / rate_hz, 0.04 s, got 0.05 s"):
        rolling(readout_time=0.05)


def test_a_moving_reading_of_a_pose_that_is_not_a_number_is_none() -> None:
    model, data = moving(TIMESTEP)
    rig = Rig(model, [spinning()], "cpu")
    list(drive(rig, data, 0.15))
    data.qpos[0] = np.nan
    for _ in range(20):
        data.time += TIMESTEP
        frames = rig.step(data)
        if frames:
            break
    stamps, ranges = frames[0].stamp.numpy(), frames[0].range.numpy()
    assert np.isnan(ranges[stamps > 0.155]).all()
    assert not np.isnan(ranges[stamps < 0.145]).any()
    assert isinstance(frames[0], Frame)
    assert not isinstance(frames[0], CameraFrame)
