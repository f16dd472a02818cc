"""Small scenes for the tests of scenes and rigs."""

from typing import Any

import mujoco
import numpy as np

from rigcast import Scene
from rigcast.sensors.scene.hits import NumpyHits

# A geom of every kind at y = {y}, whose near side a ray along +x from (0, y, 0) meets at x = 2.
KINDS = {
    "plane": 'type="plane" size="0 0 1" zaxis="-1 0 0" pos="2 {y} 0"',
    "rectangle": 'type="plane" size="1 1 1" zaxis="-1 0 0" pos="2 {y} 0"',
    "sphere": 'type="sphere" size="0.5" pos="2.5 {y} 0"',
    "capsule": 'type="capsule" size="0.5 1" pos="2.5 {y} 0"',
    "ellipsoid": 'type="ellipsoid" size="0.5 0.25 1" pos="2.5 {y} 0"',
    "cylinder": 'type="cylinder" size="0.5 1" pos="2.5 {y} 0"',
    "box": 'type="box" size="0.5 0.25 1" pos="2.5 {y} 0"',
    "mesh": 'type="mesh" mesh="cube" pos="3 {y} 0"',
    "hfield": 'type="hfield" hfield="hill" pos="3 {y} 0"',
}
ASSETS = """
<mesh name="cube" vertex="-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"/>
<mesh name="tent" vertex="-1 -1 0  1 -1 0  -1 1 0  1 1 0  0 -0.5 1  0.2 0.7 1.3"/>
<hfield name="hill" nrow="3" ncol="4" size="1 1 0.5 2" elevation="0 0.2 0 0.1 0.3 1 0.4 0 0 0.7 0.1 0"/>
"""


class Elsewhere:
    """Refuses conversion to numpy as a torch tensor on a GPU does."""

    def __len__(self) -> int:
        return 2

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise TypeError("can't convert cuda:0 device type tensor to numpy")


def model_of(worldbody: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco><asset>{ASSETS}</asset><worldbody>{worldbody}</worldbody></mujoco>")


def posed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def ready(model: mujoco.MjModel) -> Scene:
    scene = Scene(model)
    scene.update(posed(model))
    return scene


def row() -> Scene:
    """Three spheres of radius 0.1 on the x axis at 1, 3 and 5, the second in group 1, the third on a body."""
    return ready(
        model_of(
            '<geom name="first" size="0.1" pos="1 0 0"/><geom name="second" size="0.1" pos="3 0 0" group="1"/>'
            '<body name="third" pos="5 0 0"><freejoint/><geom name="third" size="0.1"/></body>'
        )
    )


def assert_missed(hits: NumpyHits) -> None:
    np.testing.assert_array_equal(hits.distance, np.inf)
    np.testing.assert_array_equal(hits.geom_id, -1)
    np.testing.assert_array_equal(hits.face, -1)
    np.testing.assert_array_equal(hits.normal, 0)
