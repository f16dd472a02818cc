"""Learn from ranges that never leave the device: where in a room is the lidar?

python examples/learn_with_torch.py [--rounds N]
"""

import mujoco
import numpy as np
import torch
import typer

import rigcast

ROOM = """
<mujoco>
  <worldbody>
    <geom type="box" size="0.1 3 1" pos="4 0 0"/> <geom type="box" size="0.1 3 1" pos="-4 0 0"/>
    <geom type="box" size="4 0.1 1" pos="0 3 0"/> <geom type="box" size="4 0.1 1" pos="0 -3 0"/>
    <geom type="box" size="0.5 0.5 1" pos="3.5 2.5 0"/>
    <body name="lidar"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
      <geom size="0.01" rgba="0 0 0 0"/></body>
  </worldbody>
</mujoco>
"""


def main(rounds: int = 300) -> None:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(ROOM)
    mount = rigcast.Mount(body="lidar")
    lidar = rigcast.Lidar(name="ring", mount=mount, elevation_deg=[0], columns=90, max_range=12)
    rig = rigcast.Rig(model, [lidar])
    data = mujoco.MjData(model)
    places = rng.uniform([-2.5, -2], [2.5, 2], (400, 2))
    scans = []
    for place in places:
        data.qpos[:] = place
        scans.append(torch.from_dlpack(rig.sense(data)["ring"].range)[0])
    seen = torch.stack(scans)
    wanted = torch.tensor(places, dtype=torch.float32, device=seen.device)
    net = torch.nn.Sequential(torch.nn.Linear(90, 64), torch.nn.ReLU(), torch.nn.Linear(64, 2)).to(seen.device)
    optimiser = torch.optim.Adam(net.parameters(), lr=3e-3)
    for _ in range(rounds):
        optimiser.zero_grad()
        loss = torch.nn.functional.mse_loss(net(seen[:320]), wanted[:320])
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        error = (net(seen[320:]) - wanted[320:]).norm(dim=1).mean()
    print(f"after {rounds} rounds: {float(error):.2f} m off in places it has not seen")


if __name__ == "__main__":
    typer.run(main)
