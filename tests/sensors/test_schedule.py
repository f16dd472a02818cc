"""Every due time is given out once, in the step that reaches it, whatever the timestep."""

from fractions import Fraction
from math import floor

import numpy as np
import pytest

from rigcast.sensors.rig.schedule import Schedule

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
    periods_per_step = Fraction(rate) * Fraction(timestep)
    reached = [floor(k * periods_per_step) for k in range(steps + 1)]
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
