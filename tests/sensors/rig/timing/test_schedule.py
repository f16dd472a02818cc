"""Every due time is returned once, in the step that reaches it, for any timestep."""

from fractions import Fraction

import numpy as np
import pytest

from rigcast.sensors.rig.timing.schedule import Schedule, uniform

# rate [Hz] and timestep [s] as exact decimals, and the number of steps
CLOCKS = [
    pytest.param("10", "0.002", 1000, id="period of 50 steps"),
    pytest.param("100", "0.01", 500, id="period of one step"),
    pytest.param("30", "0.002", 1000, id="period of 16.7 steps"),
    pytest.param("29.97", "0.001", 2000, id="period of 33.4 steps"),
    pytest.param("7.5", "0.0037", 1000, id="odd timestep"),
    pytest.param("300", "0.002", 1000, id="period of 1.67 steps"),
    pytest.param("1000", "0.003", 200, id="three per step"),
    pytest.param("10", "0.35", 20, id="three or four per step"),
    pytest.param("0.3", "0.1", 100, id="slower than 1 Hz"),
    pytest.param("10", "0.001", 100_000, id="100 s at 10 Hz"),
    pytest.param("30", "0.002", 100_000, id="200 s at 30 Hz"),
    pytest.param("500", "0.002", 100_000, id="200 s, every step"),
]


@pytest.mark.parametrize("accumulates", [False, True], ids=["k * dt", "sum of dt"])
@pytest.mark.parametrize(("rate", "timestep", "steps"), CLOCKS)
def test_each_multiple_of_the_period_falls_due_in_the_step_that_reaches_it(
    rate: str, timestep: str, steps: int, accumulates: bool
) -> None:
    dt = float(timestep)
    clock = np.cumsum(np.full(steps, dt)) if accumulates else dt * np.arange(1, steps + 1)
    schedule = Schedule(float(rate), dt)
    given = [schedule.due(time) for time in clock.tolist()]
    periods, per_steps = (Fraction(rate) * Fraction(timestep)).as_integer_ratio()
    reached = [k * periods // per_steps for k in range(steps + 1)]
    assert given == [[k / float(rate) for k in range(reached[i] + 1, reached[i + 1] + 1)] for i in range(steps)]


@pytest.mark.parametrize(
    ("rate_hz", "time", "due"),
    [
        pytest.param(10.0, 0.0, [0.0], id="at the start"),
        pytest.param(10.0, 0.02, [], id="0 was a timestep ago"),
        pytest.param(10.0, 0.1, [0.1], id="on a due time"),
        pytest.param(10.0, 5.01, [5.0], id="less than a timestep after"),
        pytest.param(10.0, 5.03, [], id="more than a timestep after"),
        pytest.param(200.0, 1.0, [0.985, 0.99, 0.995, 1.0], id="several in a timestep"),
        pytest.param(None, 3.0, [3.0], id="no rate"),
    ],
)
def test_the_first_call_looks_back_one_timestep(rate_hz: float | None, time: float, due: list[float]) -> None:
    assert Schedule(rate_hz, 0.02).due(time) == due


@pytest.mark.parametrize(
    ("phase", "time", "due"),
    [(0.0, 0.0, 0.1), (0.0, 0.05, 0.1), (0.0, 0.3 - 1e-9, 0.4), (0.04, 0.0, 0.04), (0.04, 0.04, 0.14)],
)
def test_the_next_due_time_is_after_what_the_clock_has_reached(phase: float, time: float, due: float) -> None:
    assert Schedule(10.0, 0.02, phase=phase).after(time) == pytest.approx(due)


@pytest.mark.parametrize("rate_hz", [50.0, 17.0, 3000.0, None])
def test_the_same_time_twice_gives_nothing_the_second_time(rate_hz: float | None) -> None:
    schedule = Schedule(rate_hz, 0.002)
    for time in (0.0, 0.002, 0.02):
        schedule.due(time)
        assert schedule.due(time) == []


def test_without_a_rate_every_step_is_due_once() -> None:
    schedule, clock = Schedule(None, 0.002), np.cumsum(np.full(1000, 0.002)).tolist()
    assert [schedule.due(time) for time in clock] == [[time] for time in clock]


def test_calls_that_skip_steps_catch_up() -> None:
    schedule = Schedule(10.0, 0.002)
    assert schedule.due(0.002) == []
    assert schedule.due(0.35) == [0.1, 0.2, 0.3]
    assert schedule.due(0.352) == []


@pytest.mark.parametrize("rate_hz", [10.0, 30.0, 700.0, None])
@pytest.mark.parametrize("restart", [0.0, 0.002, 0.1, 0.2501])
def test_a_clock_that_goes_back_starts_over(rate_hz: float | None, restart: float) -> None:
    used, fresh = Schedule(rate_hz, 0.002), Schedule(rate_hz, 0.002)
    for k in range(500):
        used.due(0.002 * k)
    again = [restart + 0.002 * k for k in range(500)]
    assert [used.due(time) for time in again] == [fresh.due(time) for time in again]


def drive(schedule: Schedule, timestep: float, duration: float) -> list[float]:
    return [time for k in range(1, round(duration / timestep) + 1) for time in schedule.due(k * timestep)]


@pytest.mark.parametrize("phase", [0.0, 0.001, 0.03, 0.0999])
@pytest.mark.parametrize("timestep", [0.001, 0.0037, 0.25])
def test_a_phase_moves_every_due_time(phase: float, timestep: float) -> None:
    due = drive(Schedule(10.0, timestep, phase=phase), timestep, 2.0)
    nominal = [phase + k / 10 for k in range(25)]
    clock = timestep * round(2.0 / timestep)
    assert due == [time for time in nominal if 0 < time <= clock + 1e-7]


@pytest.mark.parametrize("jitter", [0.001, 0.0499])
def test_jitter_is_uniform_and_the_same_whatever_the_timestep(jitter: float) -> None:
    fine = drive(Schedule(10.0, 0.011, jitter=jitter, key=(5, "a")), 0.011, 400.0)
    coarse = drive(Schedule(10.0, 0.31, jitter=jitter, key=(5, "a")), 0.31, 400.0)
    shared = min(len(fine), len(coarse))
    assert fine[:shared] == coarse[:shared]
    assert shared > 3980
    assert fine == sorted(fine)
    off = (np.array(fine) - np.rint(np.array(fine) * 10) / 10) / jitter
    assert np.abs(off).max() <= 1
    # Kolmogorov-Smirnov at 1e-3: 1.95 / sqrt(n)
    ranks = np.arange(1, off.size + 1) / off.size
    assert np.abs(np.sort(off) / 2 + 0.5 - ranks).max() < 1.95 / np.sqrt(off.size)


@pytest.mark.parametrize("rate_hz", [100.0, None])
def test_lost_frames_are_a_share_and_the_others_stay(rate_hz: float | None) -> None:
    whole = drive(Schedule(rate_hz, 0.01, key=(1, "a")), 0.01, 100.0)
    kept = drive(Schedule(rate_hz, 0.01, frame_loss=0.2, key=(1, "a")), 0.01, 100.0)
    more = drive(Schedule(rate_hz, 0.01, frame_loss=0.5, key=(1, "a")), 0.01, 100.0)
    assert set(more) < set(kept) < set(whole)
    # 10 000 draws: 4 standard deviations of a share are 0.016 and 0.02
    assert abs(1 - len(kept) / len(whole) - 0.2) < 0.016
    assert abs(1 - len(more) / len(whole) - 0.5) < 0.02
    assert drive(Schedule(rate_hz, 0.01, frame_loss=1.0), 0.01, 1.0) == []


def test_random_numbers_depend_on_seed_name_frame_and_draw_alone() -> None:
    keys = [(seed, name) for seed in (0, 1, 2**62) for name in ("a", "b", "lidar")]
    numbers = {uniform(key, frame, draw) for key in keys for frame in (-3, 0, 1, 10**12) for draw in (0, 1)}
    assert len(numbers) == len(keys) * 4 * 2
    assert all(0 <= number < 1 for number in numbers)
    assert uniform((7, "top"), 3, 1) == uniform((7, "top"), 3, 1)
    assert uniform((0, "a"), 0, 0) == 0.09277642842720346  # on every machine, with every numpy
