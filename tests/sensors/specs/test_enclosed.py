"""A sensor inside a geom of its carrier is named in one warning when its rig is made."""

import warnings

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast import DepthCamera, Filter, Lidar, Mount, Rig
from rigcast.sensors.specs.enclosed import enclosed

CUBE = " ".join(f"{x} {y} {z}" for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (-0.2, 0.2))
# (geom, a place in its body within it, another outside, near enough for a box around it)
GEOMS = {
    "sphere": ('size="0.2"', (0.1, 0.1, 0.1), (0.15, 0.15, 0.0)),
    "ellipsoid": ('type="ellipsoid" size="0.1 0.2 0.3"', (0.0, 0.0, 0.29), (0.09, 0.19, 0.29)),
    "capsule": ('type="capsule" size="0.1 0.2"', (0.0, 0.05, 0.28), (0.08, 0.08, 0.28)),
    "cylinder": ('type="cylinder" size="0.1 0.2"', (0.0, 0.09, 0.19), (0.08, 0.08, 0.0)),
    "box": ('type="box" size="0.1 0.2 0.3"', (0.09, 0.19, 0.29), (0.0, 0.21, 0.0)),
    "box, turned": ('type="box" size="0.1 0.2 0.3" pos="1 0 0" euler="0 0 90"', (1.19, 0.09, 0.0), (1.0, 0.19, 0.0)),
    "mesh": ('type="mesh" mesh="cube" euler="0 0 45"', (0.27, 0.0, 0.0), (0.19, 0.19, 0.0)),
}


def model_of(geom: str) -> mujoco.MjModel:
    """A body of one geom, with another fixed to it, a third that turns, and a room."""
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><asset><mesh name="cube" vertex="{CUBE}"/></asset><worldbody>
        <geom name="room" type="box" size="9 9 9"/><body name="pole" pos="5 0 0"><geom name="pole" size="0.1"/></body>
        <body name="torso" pos="1 2 3" euler="10 20 30"><freejoint/><geom name="hull" {geom}/>
        <camera name="eye"/><body name="link" pos="0 0 0.01"/>
        <body name="head"><joint/><geom name="head" size="0.05" pos="2 0 0"/></body></body></worldbody></mujoco>""")


def words(model: mujoco.MjModel, *sensors: Lidar | DepthCamera) -> list[str]:
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    return list(enclosed(model, data, sensors))


def lidar(mount: Mount, filter: Filter | None = None) -> Lidar:
    return Lidar(name="top", mount=mount, elevation_deg=[0], columns=4, filter=filter or Filter())


@pytest.mark.parametrize(("geom", "within", "outside"), GEOMS.values(), ids=GEOMS.keys())
def test_a_sensor_within_a_geom_of_its_body_is_named(
    geom: str, within: tuple[float, float, float], outside: tuple[float, float, float]
) -> None:
    model = model_of(geom)
    (word,) = words(model, lidar(Mount(body="torso", pos=within)))
    assert word.startswith("sensor 'top' is within geom 'hull' of body 'torso'")
    assert word.endswith("exclude_bodies: [torso] in its filter leaves that out")
    assert words(model, lidar(Mount(body="torso", pos=outside))) == []


ON_SURFACE = {
    "sphere": ('size="0.2"', (0.12, 0.16, 0.0)),
    "ellipsoid": ('type="ellipsoid" size="0.1 0.2 0.3"', (0.0, 0.0, 0.3)),
    "capsule": ('type="capsule" size="0.1 0.2"', (0.0, 0.0, 0.3)),
    "cylinder, cap": ('type="cylinder" size="0.1 0.2"', (0.02, 0.03, 0.2)),
    "cylinder, side": ('type="cylinder" size="0.1 0.2"', (0.06, 0.08, -0.1)),
    "box": ('type="box" size="0.1 0.2 0.3"', (0.1, 0.07, 0.3)),
    "mesh": ('type="mesh" mesh="cube" euler="0 0 45"', (0.03, 0.04, -0.2)),
}


@pytest.mark.parametrize(("geom", "place"), ON_SURFACE.values(), ids=ON_SURFACE.keys())
def test_a_sensor_on_the_surface_of_a_geom_of_its_body_is_named(geom: str, place: tuple[float, float, float]) -> None:
    """All of its ranges would be 0."""
    model = model_of(geom)
    assert len(words(model, lidar(Mount(body="torso", pos=place)))) == 1
    outwards = np.array(place) / np.linalg.norm(place)
    assert words(model, lidar(Mount(body="torso", pos=place + 1e-4 * outwards))) == []


SPHERE = GEOMS["sphere"][0]
MOUNTS = {
    "a body fixed to the geom's": (lidar(Mount(body="link")), True),
    "a camera": (DepthCamera(name="eye", mount=Mount(camera="eye"), resolution=(2, 2), fov_y_deg=50), True),
    "a body that turns": (lidar(Mount(body="head")), False),
    "in the geom of that": (lidar(Mount(body="head", pos=(2, 0, 0))), True),
    "the world, in a room": (lidar(Mount()), False),
    "a body fixed to the world": (lidar(Mount(body="pole")), True),
    "beside it, in a room": (lidar(Mount(body="pole", pos=(0, 0, 1))), False),
    "excluded": (lidar(Mount(body="torso"), Filter(exclude_bodies=["torso"])), False),
    "of a group left out": (lidar(Mount(body="torso"), Filter(geom_groups=[1])), False),
}


@pytest.mark.parametrize(("sensor", "named"), MOUNTS.values(), ids=MOUNTS.keys())
def test_what_counts_is_what_moves_along_and_may_be_hit(sensor: Lidar | DepthCamera, named: bool) -> None:
    assert bool(words(model_of(SPHERE), sensor)) == named


def test_what_has_no_name_is_called_by_its_number() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><geom size="1"/><site name="in"/></body></worldbody></mujoco>'
    )
    (word,) = words(model, lidar(Mount(site="in")))
    assert word.startswith("sensor 'top' is within geom 0 of body 1 or on its surface, which")
    assert word.endswith("; geom_groups in its filter leaves that out")


def test_a_rig_warns_once() -> None:
    model = model_of(SPHERE)
    with pytest.warns(UserWarning, match="sensor 'top' is within geom 'hull'") as caught:
        rig = Rig(model, [lidar(Mount(body="torso"))], device="cpu")
    assert [warning.filename for warning in caught] == [__file__]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rig.sense(mujoco.MjData(model))


def test_within_a_thick_open_shell_is_outside() -> None:
    """Like a car: a hollow cube with thick walls, open at one side."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]  # all but z = 1
    outer = np.array([face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))])
    rim = [face for a, b in ((1, 5), (5, 7), (7, 3), (3, 1)) for face in ((a, b, b + 8), (a, b + 8, a + 8))]
    faces = np.concatenate([outer, outer[:, ::-1] + 8, np.array(rim)])
    model = mujoco.MjModel.from_xml_string(_shell(np.concatenate([corners, 0.8 * corners]), faces))
    assert words(model, lidar(Mount(body="car"))) == []
    (word,) = words(model, lidar(Mount(body="car", pos=(0.9, 0, 0))))
    assert "'shell'" in word


def _shell(vertices: NDArray[np.float64], faces: NDArray[np.int_]) -> str:
    numbers = " ".join(map(str, vertices.ravel())), " ".join(map(str, faces.ravel()))
    return f"""
        <mujoco><asset><mesh name="shell" vertex="{numbers[0]}" face="{numbers[1]}"/></asset><worldbody>
        <body name="car"><freejoint/><geom name="shell" type="mesh" mesh="shell"/></body></worldbody></mujoco>"""
