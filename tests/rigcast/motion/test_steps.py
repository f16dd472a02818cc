"""The error of a diverged simulation names what diverged, and its joint."""

import mujoco
import numpy as np
import pytest

from rigcast.motion.steps import Diverged, physics

MODEL = mujoco.MjModel.from_xml_string("""
<mujoco><worldbody>
  <body><freejoint name="free"/><geom size="1"/><body><joint name="knee"/><geom size="1"/></body></body>
</worldbody></mujoco>""")


# the free joint has 7 positions and 6 velocities
@pytest.mark.parametrize(("field", "index", "joint"), [("qpos", 6, "free"), ("qpos", 7, "knee"), ("qvel", 6, "knee")])
def test_the_joint_that_diverges_is_named(field: str, index: int, joint: str) -> None:
    data = mujoco.MjData(MODEL)
    step = physics(MODEL, data)
    step()
    getattr(data, field)[index], data.time = np.inf, 0.5
    with pytest.raises(Diverged, match=f"at t = 0.5 s: .* of joint {joint!r}$"):
        step()
