"""Stepping a rig beside a simulation gives every frame once, in order, however the timestep falls."""

import warnings
from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast import Filter, Frame, InputError, Lidar, Mount, Rig

XML = """
<mujoco>
  <option timestep="{}"/>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="robot" pos="0 0 1000"><freejoint/><geom size="0.1"/></body>
  </worldbody>
</mujoco>
"""
pytestmark = pytest.mark.filterwarnings("ignore:sensor '.*' reads at .* Hz, the model steps at:UserWarning")
RATES = {"slow": 10.0, "odd": 30.0, "third": 100 / 3, "fast": 1000.0, "every": None}


def rig_and_data(timestep: float = 0.0037, order: tuple[str, ...] = tuple(RATES)) -> tuple[Rig, mujoco.MjData]:
    """Return a falling robot whose sensors measure its height above the floor, from 1000 m down."""
    model = mujoco.MjModel.from_xml_string(XML.format(timestep))
    ground = Filter(exclude_bodies=["robot"])
    down = Lidar(name="down", mount=Mount(body="robot"), filter=ground, elevation_deg=[-90.0], columns=1)
    lidars = [down.model_copy(update={"name": name, "rate_hz": RATES[name]}) for name in order]
    return Rig(model, lidars), mujoco.MjData(model)


def drive(rig: Rig, data: mujoco.MjData, duration: float) -> list[tuple[float, Frame]]:
    """Step simulation and rig; return the frames, each with the time of the step that gave it."""
    frames = []
    while data.time < duration:
        mujoco.mj_step(rig.model, data)
        frames += [(data.time, frame) for frame in rig.step(data)]
    return frames


def times(frames: list[tuple[float, Frame]], name: str) -> list[float]:
    return [frame.time for _, frame in frames if frame.sensor == name]


@pytest.mark.parametrize("timestep", [0.0037, 0.002, 0.001, 1 / 240, 0.01, 0.15])
def test_each_frame_comes_once_and_in_a_step_only_the_last(timestep: float) -> None:
    rig, data = rig_and_data(timestep)
    frames = drive(rig, data, 1.0)
    for name, rate in RATES.items():
        if rate is not None:
            reached = np.unique([int(timestep * k * rate + 1e-6) for k in range(round(data.time / timestep) + 1)])
            assert times(frames, name) == [k / rate for k in reached[1:].tolist()], name
    assert times(frames, "every") == sorted({time for time, _ in frames})
    assert len(times(frames, "every")) == round(data.time / timestep)


def test_frames_come_in_the_order_of_their_times() -> None:
    rig, data = rig_and_data()
    in_order = [frame.time for _, frame in drive(rig, data, 1.0)]
    assert in_order == sorted(in_order)


def test_a_frame_shows_the_world_of_the_step_that_reaches_its_time() -> None:
    rig, data = rig_and_data()
    seen = {}
    while data.time < 0.5:
        mujoco.mj_step(rig.model, data)
        for frame in rig.step(data):
            assert -1e-9 <= data.time - frame.time < rig.model.opt.timestep, (frame.sensor, frame.time)
            assert frame.range.numpy().item() == pytest.approx(data.qpos[2], rel=1e-6)
            np.testing.assert_array_equal(frame.pose[:3, 3], data.qpos[:3])
            np.testing.assert_array_equal(frame.stamp.numpy(), frame.time)
            seen[frame.sensor] = frame
    assert seen.keys() == RATES.keys()


def test_frames_are_of_the_step_even_if_they_are_taken_later() -> None:
    rig, data = rig_and_data()
    data.qpos[2] = 5
    frames = rig.step(data)
    assert {frame.sensor for frame in frames} == RATES.keys()  # which leaves them there, as a list does
    data.qpos[2] = 7
    mujoco.mj_forward(rig.model, data)
    assert {frame.range.numpy().item() for frame in frames} == {5.0}


def test_before_the_first_step_all_sensors_are_due_once() -> None:
    rig, data = rig_and_data()
    assert [(frame.sensor, frame.time) for frame in rig.step(data)] == [(name, 0.0) for name in RATES]
    assert rig.step(data) == []


@pytest.mark.parametrize("stop", [0.05, 0.0999, 0.4])
def test_a_reset_starts_over(stop: float) -> None:
    rig, data = rig_and_data()
    drive(rig, data, stop)
    mujoco.mj_resetData(rig.model, data)
    again = drive(rig, data, 0.3)
    fresh_rig, fresh_data = rig_and_data()
    fresh = drive(fresh_rig, fresh_data, 0.3)
    assert [(f.sensor, f.time, f.range.numpy().item()) for _, f in again] == [
        (f.sensor, f.time, f.range.numpy().item()) for _, f in fresh
    ]


def test_a_reset_to_the_middle_goes_on_from_there() -> None:
    rig, data = rig_and_data(0.002)
    drive(rig, data, 0.5)
    data.time = 0.25
    assert times(drive(rig, data, 0.45), "slow") == [0.3, 0.4]


def test_sense_between_steps_changes_no_schedule() -> None:
    rig, data = rig_and_data()
    plain_rig, plain_data = rig_and_data()
    stepped: list[tuple[str, float]] = []
    while data.time < 0.2:
        mujoco.mj_step(rig.model, data)
        assert {frame.time for frame in rig.sense(data).values()} == {data.time}
        stepped += [(frame.sensor, frame.time) for frame in rig.step(data)]
        rig.cast(data)
    assert stepped == [(frame.sensor, frame.time) for _, frame in drive(plain_rig, plain_data, 0.2)]


def test_the_order_of_the_sensors_changes_no_times() -> None:
    (rig, data), (turned_rig, turned_data) = rig_and_data(), rig_and_data(order=tuple(RATES)[::-1])
    frames, turned = drive(rig, data, 0.3), drive(turned_rig, turned_data, 0.3)
    for name in RATES:
        assert times(frames, name) == times(turned, name)


def test_a_rig_without_sensors_gives_nothing() -> None:
    rig, data = rig_and_data(order=())
    assert drive(rig, data, 0.1) == []
    assert rig.sense(data) == {}


@pytest.mark.parametrize(("latency", "timestep"), [(0.001, 0.0037), (0.05, 0.01), (0.25, 1 / 240), (0.0123, 0.02)])
def test_a_frame_comes_in_when_its_latency_has_passed(latency: float, timestep: float) -> None:
    rig, data = rig_and_data(timestep)
    plain = drive(rig, data, 0.5)
    late_rig = Rig(rig.model, [spec.model_copy(update={"latency": latency}) for spec in rig.sensors])
    late = drive(late_rig, mujoco.MjData(rig.model), 0.5)
    for name in RATES:
        given, expected = times(late, name), times(plain, name)
        assert given == expected[: len(given)], name
        assert all(time + latency > 0.5 - 1e-9 for time in expected[len(given) :]), name
    heights = {(frame.sensor, frame.time): frame.range.numpy().item() for _, frame in plain}
    for clock, frame in late:
        assert -1e-6 < clock - (frame.time + latency) < timestep, (frame.sensor, frame.time)
        assert frame.range.numpy().item() == heights[frame.sensor, frame.time]


def test_frames_with_latencies_come_in_as_they_arrive() -> None:
    rig, _ = rig_and_data(0.01)
    mixed = [spec.model_copy(update={"latency": 0.013 * k}) for k, spec in enumerate(rig.sensors)]
    late = {spec.name: spec.latency for spec in mixed}
    arrivals = [
        frame.time + late[frame.sensor] for _, frame in drive(Rig(rig.model, mixed), mujoco.MjData(rig.model), 0.5)
    ]
    assert arrivals == sorted(arrivals)


def test_a_reset_discards_what_has_not_come_in() -> None:
    rig, data = rig_and_data(0.01)
    late = Rig(rig.model, [spec.model_copy(update={"latency": 0.2}) for spec in rig.sensors])
    drive(late, data, 0.35)
    mujoco.mj_resetData(rig.model, data)
    again = [(clock, frame.sensor, frame.time) for clock, frame in drive(late, data, 0.5)]
    fresh_rig = Rig(rig.model, late.sensors)
    fresh = drive(fresh_rig, mujoco.MjData(rig.model), 0.5)
    assert again == [(clock, frame.sensor, frame.time) for clock, frame in fresh]


SPREAD = (
    Lidar(name="table", mount=Mount(body="robot"), preset="velodyne_vlp16"),
    Lidar(name="rosette", mount=Mount(body="robot"), preset="livox_mid40", jitter=0.01),
    Lidar(name="sector", mount=Mount(body="robot"), preset="hokuyo_utm30lx", phase=0.003),
)


@pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")
@pytest.mark.parametrize("timestep", [0.0037, 0.02, 0.3])
def test_readings_are_whole_and_stamped_whatever_the_timestep(timestep: float) -> None:
    model = mujoco.MjModel.from_xml_string(XML.format(timestep))
    patterns = {spec.name: spec.pattern(model) for spec in SPREAD}
    seen = set()
    for _, frame in drive(Rig(model, SPREAD, seed=3), mujoco.MjData(model), 0.6):
        pattern = patterns[frame.sensor].at(frame.time)
        assert frame.shape == pattern.shape
        assert pattern.firing_times is not None
        stamp = frame.stamp.numpy()
        np.testing.assert_array_equal(stamp, frame.time + pattern.firing_times)
        assert stamp.min() == frame.time
        seen.add(frame.sensor)
    assert seen == patterns.keys()


def test_a_rosette_looks_elsewhere_in_each_reading() -> None:
    model = mujoco.MjModel.from_xml_string(XML.format(0.01))
    spec = Lidar(name="rosette", mount=Mount(pos=(0, 0, 2), euler_deg=(0, 90, 0)), preset="livox_mid40", noise=None)
    rig, data = Rig(model, [spec]), mujoco.MjData(model)
    data.qpos[2] = 5
    first, second = (rig.sense(data)["rosette"] for data.time in (0.3, 0.4))
    for frame in (first, second):
        directions = spec.pattern(model).at(frame.time).directions
        np.testing.assert_allclose(frame.range.numpy(), 2 / directions[:, 0], rtol=1e-5)
        np.testing.assert_allclose(frame.points.numpy(), 2 / directions[:, :1] * directions, rtol=1e-5, atol=1e-5)
    assert np.abs(first.range.numpy() - second.range.numpy()).max() > 0.01


@pytest.mark.parametrize(
    "given",
    [
        {"elevation_deg": [-20, 0, 20], "columns": 24, "rate_hz": 10, "scan_time": 0},
        {"preset": "livox_mid40", "noise": None, "motion": False, "rate_hz": 10},
    ],
    ids=["the same each time", "another each time"],
)
def test_readings_of_one_sensor_in_one_step_look_where_each_does_alone(given: dict[str, Any]) -> None:
    model = mujoco.MjModel.from_xml_string(XML.format(0.1))
    spec = Lidar(name="lidar", mount=Mount(pos=(0, 0, 2), euler_deg=(0, 90, 0)), jitter=0.049, **given)
    rig, data = Rig(model, [spec], "cpu"), mujoco.MjData(model)
    frames: list[Frame] = []
    while len(frames) < 2:  # one that is late, and the next, which is early
        data.time += 0.1
        frames = rig.step(data)
    for frame in frames:
        data.time = frame.time
        alone = Rig(model, [spec], "cpu").sense(data)["lidar"]
        np.testing.assert_array_equal(frame.range.numpy(), alone.range.numpy())


@pytest.mark.parametrize(
    ("rate_hz", "skipped", "expected"),
    [
        pytest.param(100, 25, [0.05, 0.1, 0.15, 0.2], id="many due, the last one now"),
        pytest.param(65, 25, [0.1, 0.15, 0.2], id="many due, none now"),
        pytest.param(10, 25, [0.1, 0.2], id="one due, now"),
        pytest.param(10, 20, [0.12, 0.2], id="one due, some steps ago"),
        pytest.param(None, 25, [0.05, 0.1, 0.15, 0.2], id="no rate"),
    ],
)
def test_calls_that_skip_steps_give_one_frame_of_a_state_with_its_time(
    rate_hz: float | None, skipped: int, expected: list[float]
) -> None:
    """Frames for the due times in between would all show the world at the time of the call."""
    rig, data = rig_and_data(0.002, ("every",))
    spec = rig.sensors[0].model_copy(update={"rate_hz": rate_hz})
    rig, got = Rig(rig.model, [spec], "cpu"), []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(round(0.2 / 0.002) // skipped):
            for _ in range(skipped):
                mujoco.mj_step(rig.model, data)
            for frame in rig.step(data):
                assert frame.range.numpy().item() == pytest.approx(data.qpos[2], rel=1e-6)
                np.testing.assert_array_equal(frame.stamp.numpy(), frame.time)
                got.append(frame.time)
    np.testing.assert_allclose(got, expected, atol=1e-9)
    said = [str(warning.message) for warning in caught]
    of_rates: dict[float | None, int] = {100: 5, 65: 3}
    fell_due = of_rates.get(rate_hz)
    assert len(said) == (fell_due is not None), "once, though it happened at each call"
    for each in said:
        assert f"sensor 'every' at {rate_hz} Hz: {fell_due} readings fell due since the last rig.step" in each
        assert "gives 1, as all would show" in each
        assert caught[0].filename == __file__


def test_a_sensor_that_moves_is_read_at_every_due_time_between_calls() -> None:
    rig, data = rig_and_data(0.002, ("every",))
    sweeping = rig.sensors[0].model_copy(update={"rate_hz": 100.0, "motion": True})
    moving, got = Rig(rig.model, [sweeping], "cpu"), []
    for _ in range(100):
        mujoco.mj_step(rig.model, data)
        if round(data.time / 0.002) % 25 == 0:
            got += moving.step(data)
    assert [frame.time for frame in got] == pytest.approx([k / 100 for k in range(5, 21)])
    heights = [1000 - 9.81 / 2 * frame.time**2 for frame in got]
    assert [frame.range.numpy().item() for frame in got] == pytest.approx(heights, abs=0.02)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("given", "is_named"),
    [
        ({"rate_hz": 501}, True),
        ({"rate_hz": 500}, False),
        ({"rate_hz": None}, False),
        ({"rate_hz": 501, "motion": True}, False),
    ],
)
def test_a_rig_names_sensors_that_read_more_often_than_the_model_steps(given: dict[str, Any], is_named: bool) -> None:
    rig, _ = rig_and_data(0.002, ("every",))
    spec = rig.sensors[0].model_copy(update=given)
    if is_named:
        with pytest.warns(UserWarning, match="sensor 'every' reads at 501 Hz, the model steps at 500 Hz"):
            Rig(rig.model, [spec], "cpu")
    else:
        Rig(rig.model, [spec], "cpu")


def test_two_data_in_turn_are_refused() -> None:
    """One of them would get no frames, as the other has reached the times at which they fall due."""
    rig, first = rig_and_data(0.002, ("slow",))
    second = mujoco.MjData(rig.model)
    drive(rig, first, 0.05)
    mujoco.mj_step(rig.model, second)
    second.time = first.time
    for _ in range(2):
        with pytest.raises(InputError, match=r"got another MjData than in the call before, which was at 0\.05.* s"):
            rig.step(second)
    assert times(drive(rig, first, 0.25), "slow") == [0.1, 0.2], "the first goes on as if it had not been"
    rig.reset()
    assert rig.step(second) == []
    with pytest.raises(InputError, match=r"one rig for each MjData, or rig\.reset"):
        rig.step(first)


def test_another_data_may_begin_another_episode() -> None:
    rig, first = rig_and_data(0.002, ("slow",))
    drive(rig, first, 0.25)
    assert times(drive(rig, mujoco.MjData(rig.model), 0.25), "slow") == [0.1, 0.2], "its clock begins again"
    del first
    later = mujoco.MjData(rig.model)
    later.time = 0.25
    assert times(drive(rig, later, 0.35), "slow") == [0.3], "nobody has the other any more"
