"""The scene for sensors' errors has what they need, and its fan spins."""

from pathlib import Path

import mujoco
import pytest

SCENE = Path(__file__).resolve().parents[2] / "configs" / "effects.xml"


@pytest.mark.parametrize("name", ["glass", "mirror", "dark_wall", "box", "near_ball", "back_wall"])
def test_scene_has(name: str) -> None:
    assert mujoco.MjModel.from_xml_path(str(SCENE)).geom(name).id >= 0


# keyframe, joint and its speed [rad/s or m/s]
@pytest.mark.parametrize(
    ("key", "joint", "speed"),
    [
        ("spinning", "fan", 30),
        ("spinning", "cart_x", 0),
        ("moving", "fan", 40),
        ("moving", "cart_x", 2),
        ("moving", "cart_turn", 4),
    ],
)
def test_what_moves_keeps_its_speed(key: str, joint: str, speed: float) -> None:
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    start = data.joint(joint).qpos[0]
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    assert data.joint(joint).qpos[0] - start == pytest.approx(speed, rel=0.01, abs=1e-9)
    assert not any(warning.number for warning in data.warning)
