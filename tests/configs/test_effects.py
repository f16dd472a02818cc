"""The scene of the sensors' errors holds what it is there to show, and its fan spins."""

from pathlib import Path

import mujoco
import pytest

SCENE = Path(__file__).resolve().parents[2] / "configs" / "effects.xml"


@pytest.mark.parametrize("name", ["glass", "mirror", "dark_wall", "box", "near_ball", "back_wall"])
def test_scene_has(name: str) -> None:
    assert mujoco.MjModel.from_xml_path(str(SCENE)).geom(name).id >= 0


def test_the_fan_spins() -> None:
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("spinning").id)
    start = data.joint("fan").qpos[0]
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    assert data.joint("fan").qpos[0] - start == pytest.approx(30.0, rel=0.01)
    assert not any(warning.number for warning in data.warning)
