"""A gymnasium environment with a lidar in its observation, and a simple policy that turns the robot away from walls.

pip install 'rigcast[gym]'; python examples/avoid_walls.py [--steps N]
"""

from typing import Any

import gymnasium
import mujoco
import numpy as np
import typer

import rigcast
from rigcast.gym import RigObservation

ROOM = """
<mujoco>
  <option timestep="0.02"/>
  <worldbody>
    <geom type="box" size="0.1 3 1" pos="3 0 0.5"/> <geom type="box" size="0.1 3 1" pos="-3 0 0.5"/>
    <geom type="box" size="3 0.1 1" pos="0 3 0.5"/> <geom type="box" size="3 0.1 1" pos="0 -3 0.5"/>
    <geom type="cylinder" size="0.4 1" pos="1 1 0.5"/>
    <body name="robot" pos="-1 -1 0.3">
      <joint type="slide" axis="1 0 0"/> <joint type="slide" axis="0 1 0"/> <joint type="hinge" axis="0 0 1"/>
      <geom size="0.2"/>
    </body>
  </worldbody>
</mujoco>
"""


class Room(gymnasium.Env[Any, Any]):
    """Drives at 1 m/s; the action is the rate of turn [rad/s]."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float64)
    action_space = gymnasium.spaces.Box(-3.0, 3.0, (1,), np.float32)

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(ROOM)
        self.data = mujoco.MjData(self.model)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[2] = self.np_random.uniform(-np.pi, np.pi)
        return self.data.qpos.copy(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        heading = self.data.qpos[2]
        self.data.qvel[:] = np.cos(heading), np.sin(heading), action[0]
        mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy(), 1.0, self.data.ncon > 0, False, {}


def main(steps: int = 1000) -> None:
    room = Room()
    lidar = rigcast.Lidar(
        name="ahead",
        mount=rigcast.Mount(body="robot"),
        filter=rigcast.Filter(exclude_bodies=["robot"]),
        elevation_deg=[0],
        azimuth_deg=(-60, 60),
        columns=31,
        max_range=5,
    )
    env = RigObservation(room, rigcast.Rig(room.model, [lidar]))
    observation, _ = env.reset(seed=1)
    nearest, turn = np.inf, 0.0
    for step in range(steps):
        ahead = observation["ahead"][0]
        nearest = min(nearest, float(ahead.min()))
        right, left = ahead[:15].min(), ahead[16:].min()
        if ahead.min() > 1.2:
            turn = 0.0
        elif turn == 0.0:  # keep turning the same way until it is free
            turn = 3.0 if left > right else -3.0
        observation, _, hit, _, _ = env.step(np.array([turn], np.float32))
        if hit:
            print(f"hit a wall after {step} steps")
            return
    print(f"{steps} steps without a hit, {nearest:.2f} m from a wall at the nearest")


if __name__ == "__main__":
    typer.run(main)
