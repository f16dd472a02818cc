"""The robot of these tests, and the states that its worlds are in."""

import mujoco
import pytest
from world_states import COUNT, model, states


@pytest.fixture(scope="module")
def robot() -> mujoco.MjModel:
    return model()


@pytest.fixture
def datas(robot: mujoco.MjModel) -> list[mujoco.MjData]:
    return states(robot, COUNT)
