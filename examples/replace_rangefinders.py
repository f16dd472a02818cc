"""From MuJoCo's rangefinders to a rig: the same readings, checked against MuJoCo's, and what a lidar adds.

python examples/replace_rangefinders.py [--steps N]
"""

import mujoco
import numpy as np
import typer

import rigcast

DRONE = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="9 9 1"/>
    <geom name="crate" type="box" size="0.5 0.5 0.5" pos="1.5 0 0.5"/>
    <body name="drone" pos="0 0 2">
      <freejoint/>
      <geom type="box" size="0.2 0.2 0.05"/>
      <site name="down" euler="180 0 0"/> <site name="ahead" euler="0 130 0"/> <site name="up"/>
    </body>
  </worldbody>
  <sensor>
    <rangefinder name="down" site="down"/> <rangefinder name="ahead" site="ahead"/> <rangefinder name="up" site="up"/>
  </sensor>
</mujoco>
"""


def main(steps: int = 100) -> None:
    model = mujoco.MjModel.from_xml_string(DRONE)
    data = mujoco.MjData(model)
    rig = rigcast.Rig(model, rigcast.from_model(model))
    worst = 0.0
    for _ in range(steps):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)  # MuJoCo's readings of now, not of the step before
        for name, frame in rig.sense(data).items():
            theirs, ours = data.sensor(name).data[0], frame.range.numpy().item()
            if np.isfinite(ours):
                worst = max(worst, abs(ours - theirs))
            elif theirs != -1:
                raise SystemExit(f"{name}: MuJoCo reads {theirs} m, the rig nothing")
    print(f"{steps} steps: at most {worst * 1e6:.2f} µm from MuJoCo's own readings")
    for name, frame in rig.sense(data).items():
        geom = frame.geom_id.numpy().item()
        print(f"{name}: {frame.range.numpy().item():.3f} m, {model.geom(geom).name if geom >= 0 else 'nothing'}")


if __name__ == "__main__":
    typer.run(main)
