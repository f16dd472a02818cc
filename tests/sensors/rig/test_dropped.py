"""A rig that is dropped releases its arrays at once: none of them waits for Python's collector of reference cycles."""

import gc

import mujoco
import pytest
import warp as wp
from world_states import SENSORS, model, rig_of, states

pytestmark = pytest.mark.usefixtures("no_older_objects")

MODEL = model()
# Rosettes and stereo cameras leave the arrays of one cast in reference cycles.
CYCLIC = ("rosette", "stereo", "kinect")


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other threads release the arrays of a launch a moment after it is done."""
    monkeypatch.setenv("RIGCAST_THREADS", "1")


def read_twice(name: str, worlds: list[mujoco.MjData]) -> None:
    """Read a new rig of one sensor, first in one world, then in all; and drop it."""
    rig = rig_of(MODEL, name)
    for data in (worlds[0], worlds):
        rig.sense(data)[name].range.numpy()


def arrays() -> int:
    """The number of Warp arrays that exist."""
    return sum(type(each) is wp.array for each in gc.get_objects())


@pytest.mark.parametrize("name", sorted(SENSORS.keys() - CYCLIC))
def test_a_dropped_rig_leaves_no_arrays_to_the_collector(name: str) -> None:
    worlds = states(MODEL, 2)
    read_twice(name, worlds)  # what is kept for good is made
    gc.collect()
    before = arrays()
    gc.disable()
    try:
        read_twice(name, worlds)
        assert arrays() <= before
    finally:
        gc.enable()
