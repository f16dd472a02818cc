"""The error of a diverged simulation names what diverged, and its joint."""

import mujoco
import numpy as np
import pytest

from rigcast.motion.simulation import divergence

MODEL = mujoco.MjModel.from_xml_string("""
<mujoco><worldbody>
  <body><freejoint name="free"/><geom size="1"/><body><joint name="knee"/><geom size="1"/></body></body>
</worldbody></mujoco>""")


# the free joint has 7 positions and 6 velocities
@pytest.mark.parametrize(("field", "index", "joint"), [("qpos", 6, "free"), ("qpos", 7, "knee"), ("qvel", 6, "knee")])
def test_the_joint_that_diverges_is_named(field: str, index: int, joint: str) -> None:
    data = mujoco.MjData(MODEL)
    assert divergence(MODEL, data, 0.0) is None
    getattr(data, field)[index] = np.inf
    mujoco.mj_step(MODEL, data)
    assert str(divergence(MODEL, data, 0.5)).endswith(f" of joint {joint!r}")
    assert "t = 0.5 s" in str(divergence(MODEL, data, 0.5))
