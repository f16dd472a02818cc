"""The parts of a rig or a scene cannot be replaced, which would give wrong frames or end the process."""

import mujoco
import pytest

from rigcast import Lidar, Mount, Rig, Scene

MODEL = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
LIDAR = Lidar(name="lidar", mount=Mount(), elevation_deg=[0], columns=4)


@pytest.mark.parametrize("name", ["model", "sensors", "props", "scene"])
def test_attributes_of_a_rig_cannot_be_assigned(name: str) -> None:
    rig = Rig(MODEL, [LIDAR], "cpu")
    before = getattr(rig, name)
    with pytest.raises(AttributeError, match=f"Rig.{name} cannot be set; make a new Rig"):
        setattr(rig, name, before)
    assert getattr(rig, name) is before


@pytest.mark.parametrize("name", ["model", "device", "shape_ids", "body_of_shape", "room", "in_use"])
def test_attributes_of_a_scene_cannot_be_assigned(name: str) -> None:
    scene = Scene(MODEL, "cpu")
    before = getattr(scene, name)
    with pytest.raises(AttributeError, match=f"Scene.{name} cannot be set; make a new Scene"):
        setattr(scene, name, before)
    assert getattr(scene, name) is before
