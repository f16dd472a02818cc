"""Which of many plans keeps the robot farthest from obstacles? mujoco.rollout, with a lidar read in each state.

python examples/clearance_of_rollouts.py [--plans N]
"""

import mujoco
import mujoco.rollout
import numpy as np
import typer

import rigcast

CART = """
<mujoco>
  <option timestep="0.02"/>
  <worldbody>
    <geom type="plane" size="9 9 1"/>
    <geom type="box" size="0.1 2 1" pos="3 0 1"/>
    <geom type="cylinder" size="0.3 1" pos="1.5 1.5 1"/>
    <body name="cart" pos="0 0 0.3">
      <joint name="x" type="slide" axis="1 0 0" damping="2"/>
      <joint name="y" type="slide" axis="0 1 0" damping="2"/>
      <geom size="0.2" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><motor joint="x" gear="60"/><motor joint="y" gear="60"/></actuator>
</mujoco>
"""


def main(plans: int = 12) -> None:
    model = mujoco.MjModel.from_xml_string(CART)
    mount, own = rigcast.Mount(body="cart"), rigcast.Filter(exclude_bodies=["cart"])
    lidar = rigcast.Lidar(name="ring", mount=mount, elevation_deg=[0], columns=180, max_range=20, filter=own)
    rig = rigcast.Rig(model, [lidar])
    data = mujoco.MjData(model)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, start, full)
    heading = np.arange(plans) * 2 * np.pi / plans
    push = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    states, _ = mujoco.rollout.rollout(model, data, np.tile(start, (plans, 1)), np.tile(push[:, None], (1, 40, 1)))
    clearance = np.full(plans, np.inf)
    for plan in range(plans):
        for state in states[plan, 8::8]:
            mujoco.mj_setState(model, data, state, full)
            clearance[plan] = min(clearance[plan], rig.sense(data)["ring"].range.numpy().min())
    best = int(np.argmax(clearance))
    degrees = np.rad2deg(heading[best])
    print(f"of {plans} headings, {degrees:.0f} deg is best: soon never nearer than {clearance[best]:.2f} m")


if __name__ == "__main__":
    typer.run(main)
