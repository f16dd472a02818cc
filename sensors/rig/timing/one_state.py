"""One frame of one state of the world: readings of it that fell due at several times would be copies of each other.

Sensors that move read the world between its states too, and are no concern of this.
"""

from collections.abc import Iterable, Iterator

from rigcast.sensors.specs.sensor_spec import SensorSpec

_ROUNDING = 1e-3  # of a timestep: clocks are sums of many


def reads_too_often(sensor: SensorSpec, timestep: float) -> bool:
    """Whether several readings fall due within a timestep [s], of which only one state can be seen."""
    return sensor.rate_hz is not None and sensor.rate_hz * timestep > 1 + 1e-6 and not sensor.moves


def too_often(sensors: Iterable[SensorSpec], timestep: float) -> Iterator[str]:
    """A sentence for each sensor that reads more often than there are states."""
    for sensor in sensors:
        if reads_too_often(sensor, timestep):
            steps = 1 / timestep
            yield (
                f"sensor {sensor.name!r} reads at {sensor.rate_hz:g} Hz, the model steps at {steps:g} Hz: rig.step "
                f"gives one frame of a step, expected rate_hz of {steps:g} or less, or a smaller timestep"
            )


def times_of_one_state(sensor: SensorSpec, due: list[float], now: float, timestep: float) -> list[float]:
    """The times [s] of the readings to make of the state at `now` [s], given the times at which they fell due.

    Those due within the last timestep keep their times. Earlier ones were of states that the rig was not shown: if
    there are no others, one reading is made now.
    """
    recent = [time for time in due if now - time <= timestep * (1 + _ROUNDING)]
    if reads_too_often(sensor, timestep):
        recent = recent[-1:]
    return recent or [now]


def missed(sensor: SensorSpec, due: int, given: int) -> str:
    """A sentence about readings that fell due while the rig was not stepped, and are not made."""
    return (
        f"sensor {sensor.name!r} at {sensor.rate_hz:g} Hz: {due} readings fell due since the last rig.step, which "
        f"gives {given}, as all would show the world as it is now; expected rig.step after each mj_step, or a rate_hz "
        "of at most the rate of its calls"
    )
