"""Casts launched at once have the readings of each cast alone, bit for bit."""

import pytest
from made_worlds import random_plan
from several_casts import SEED, check_at_once, rays_of_sensors

from rigcast.kernels.cast import launch


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_sensors_read_at_once_what_each_reads_alone(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIGCAST_THREADS", str(threads))
    check_at_once(random_plan(SEED).world(), rays_of_sensors())


def test_nothing_is_launched_of_no_sensor() -> None:
    assert launch([]) is None
