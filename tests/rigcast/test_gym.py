"""A rig's readings as observations for gymnasium and a policy."""

import sys
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import rigcast
from rigcast.gym import RigObservation

SCENE = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <body name="cart" pos="0 0 0.5"><joint name="slide" type="slide" axis="1 0 0"/><geom size="0.1"/></body>
  </worldbody>
  <actuator><motor joint="slide" gear="10"/></actuator>
</mujoco>
"""


class Cart(gymnasium.Env[Any, Any]):
    """A cart that is pushed towards a wall."""

    action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)

    def __init__(self, as_dict: bool = False) -> None:
        self.model = mujoco.MjModel.from_xml_string(SCENE)
        self.data = mujoco.MjData(self.model)
        place = gymnasium.spaces.Box(-100, 100, (2,), np.float64)
        self.as_dict = as_dict
        self.observation_space = gymnasium.spaces.Dict({"place": place}) if as_dict else place

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[0] = self.np_random.uniform(-1, 1)
        return self._seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data)
        return self._seen(), 0.0, False, False, {}

    def _seen(self) -> Any:
        place = np.concatenate([self.data.qpos, self.data.qvel])
        return {"place": place} if self.as_dict else place


def rig_of(env: Cart, **given: Any) -> rigcast.Rig:
    mount = rigcast.Mount(body="cart", pos=(0.2, 0, 0))
    sensors: list[rigcast.Lidar | rigcast.DepthCamera] = [
        rigcast.Lidar(**{"name": "top", "max_range": 10.0, **given}, mount=mount, elevation_deg=[0, 40], columns=12),
        rigcast.DepthCamera(name="front", mount=mount, resolution=(8, 6), fov_y_deg=60, min_range=0.6, max_range=5),
    ]
    return rigcast.Rig(env.model, sensors, device="cpu")


@pytest.mark.parametrize("as_dict", [False, True])
@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version.*")  # it is meant to be
def test_it_passes_the_checks_of_gymnasium(as_dict: bool) -> None:
    env = Cart(as_dict)
    check_env(RigObservation(env, rig_of(env)), skip_render_check=True)


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version.*")
def test_a_seed_is_one_of_the_readings_too() -> None:
    env = Cart()
    wrapped = RigObservation(env, rig_of(env, noise=rigcast.Noise(range_std=0.1)))
    check_env(wrapped, skip_render_check=True)  # which resets twice with one seed
    seen = [wrapped.reset(seed=seed)[0]["top"] for seed in (7, 7, 8, None)]
    np.testing.assert_array_equal(seen[0], seen[1])
    assert not (seen[1] == seen[2]).all()
    assert not (seen[2] == seen[3]).all()


def test_the_spaces_say_what_comes() -> None:
    env = Cart()
    wrapped = RigObservation(env, rig_of(env))
    space: Any = wrapped.observation_space
    assert set(space) == {"state", "top", "front"}
    assert (space["top"].shape, space["top"].dtype, space["top"].high.max()) == ((2, 12), np.float32, 10)
    assert (space["front"].shape, space["front"].low.min(), space["front"].high.max()) == ((6, 8), 0, 5)
    for seed in range(5):
        observation, _ = wrapped.reset(seed=seed)
        assert space.contains(observation), seed


def test_what_has_no_range_is_within_the_bounds() -> None:
    env = Cart()
    wrapped = RigObservation(env, rig_of(env))
    wrapped.reset(seed=0)
    env.data.qpos[0] = 0.5
    top = wrapped.observation(None)["top"]
    assert top[0, 0] == pytest.approx(3.9 - 0.7)
    assert top[1, 6] == 10  # into the sky
    env.data.qpos[0] = 3.2  # the wall is 0.5 m away, nearer than the camera's minimum
    assert wrapped.observation(None)["front"][2, 3] == 0


def test_an_endless_range_is_refused() -> None:
    env = Cart()
    with pytest.raises(rigcast.InputError, match="max_range of 'top': got inf, expected a finite one"):
        RigObservation(env, rig_of(env, max_range=float("inf")))


def test_a_name_that_is_taken_is_refused() -> None:
    env = Cart()
    with pytest.raises(rigcast.InputError, match="the observation has 'state' already"):
        RigObservation(env, rig_of(env, name="state"))


def test_an_environment_without_data_is_refused() -> None:
    env = Cart()
    wrapped = RigObservation(env, rig_of(env))
    env.data = None
    with pytest.raises(rigcast.InputError, match=r"env\.unwrapped\.data: got NoneType, expected MjData"):
        wrapped.observation(None)


def test_without_gymnasium_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "rigcast.gym")
    with pytest.raises(rigcast.InputError, match=r"rigcast\.gym needs gymnasium, .* 'rigcast\[gym\]' brings it"):
        __import__("rigcast.gym")
