"""Skins in a scene: their vertices are MuJoCo's, filters see them as they see geoms, and a lost bone hides one."""

import mujoco
import numpy as np
import pytest
import trimesh
from small_scenes import posed

from rigcast import Filter, Scene
from rigcast.sensors.scene.parts.skins import Skins

BONE = '<bone body="{}" bindpos="{}" bindquat="{}" vertid="{}" vertweight="{}"/>'
BODIES = """<body name="upper" pos="0 0 1"><freejoint/><geom size=".01" group="3"/>
<body name="lower" pos=".6 0 0"><joint type="ball"/><geom size=".01" group="3"/></body></body>
<geom name="floor" type="plane" size="0 0 1" pos="0 0 -1" group="2"/>"""


def numbers(values: object) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(np.asarray(values)))


def sleeve(name: str, place: tuple[float, float, float], attributes: str = "") -> str:
    """A ball stretched over both bodies; vertices of its middle third follow both."""
    ball = trimesh.creation.icosphere(2)
    weight = np.clip(1.5 * ball.vertices[:, 0] + 0.5, 0, 1)
    bones = [
        BONE.format(body, numbers(np.add(place, shift)), turn, numbers(np.flatnonzero(w)), numbers(w[w > 0]))
        for body, shift, turn, w in (
            ("upper", (-0.3, 0, 0), "1 0 0 0", 1 - weight),
            ("lower", (0.3, 0, 0), ".8 0 .6 0", weight),
        )
    ]
    shape = f'vertex="{numbers(ball.vertices * (0.6, 0.2, 0.2) + place)}" face="{numbers(ball.faces)}"'
    return f'<skin name="{name}" {shape} {attributes}>{"".join(bones)}</skin>'


def model_of(*skins: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{BODIES}</worldbody><deformable>{''.join(skins)}</deformable></mujoco>"
    )


def moved(model: mujoco.MjModel, k: int) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, np.random.default_rng(k).normal(size=model.nv), 0.3 * k)
    mujoco.mj_kinematics(model, data)
    return data


def corners_of(skins: Skins, data: mujoco.MjData) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Corners (faces, 3, 3) of the triangles of all skins in the world [m]."""
    position = skins.update(data).position
    world = []
    for tree, center in zip(skins.trees, position, strict=True):
        face = tree.blocks["face"].ravel()
        places = [np.stack([tree.blocks[f"{axis}{k}"].ravel() for axis in "xyz"], axis=-1) for k in range(3)]
        stacked = np.stack(places, axis=1)[face >= 0]
        world.append(stacked[np.argsort(face[face >= 0])] + center)
    return np.concatenate(world)


def test_vertices_are_those_that_mujoco_draws() -> None:
    model = model_of(sleeve("bare", (0, 0, 1)), sleeve("coat", (3, 1, 0.5), 'inflate="0.05"'))
    skins = Skins(model)
    drawn = mujoco.MjvScene(model, 100)
    first = np.repeat(model.skin_vertadr, model.skin_facenum)[:, None]
    for k in range(4):
        data = moved(model, k)
        flags = int(mujoco.mjtCatBit.mjCAT_ALL)
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), flags, drawn)
        vertices = np.array(drawn.skinvert).reshape(-1, 3)
        expected = vertices[model.skin_face.reshape(-1, 3) + first]
        np.testing.assert_allclose(corners_of(skins, data), expected, rtol=0, atol=2e-6, err_msg=f"state {k}")


def test_a_hit_names_its_skin_and_face() -> None:
    model = model_of(sleeve("bare", (0, 0, 1)))
    scene = Scene(model)
    scene.update(posed(model))
    hit = scene.cast((0, 0, 5), (0, 0, -1)).numpy()
    assert [int(i) for i in (hit.skin_id, hit.geom_id, hit.flex_id, hit.prop_id)] == [0, -1, -1, -1]
    assert 0 <= hit.face < model.nskinface
    assert hit.normal[2] > 0.9


SEEN = [
    (Filter(), True),
    (Filter(geom_groups=[4]), True),
    (Filter(geom_groups=[0, 3]), False),
    (Filter(geometry="visual"), True),
    (Filter(geometry="collision"), False),
    (Filter(static=False), True),
    (Filter(exclude_bodies=["upper"]), True),
    (Filter(exclude_bodies=["upper", "lower"]), False),
    (Filter(exclude_bodies=["upper"], exclude_subtree=True), False),
]


@pytest.mark.parametrize(("filter", "is_seen"), SEEN, ids=lambda value: str(value)[:60])
def test_a_filter_treats_skins_as_it_treats_geoms(filter: Filter, is_seen: bool) -> None:
    scene = Scene(model_of(sleeve("coat", (0, 0, 1), 'group="4"')))
    scene.update(posed(scene.model))
    assert (scene.cast((0, 0, 5), (0, 0, -1), filter=filter).numpy().skin_id == 0) == is_seen


def test_a_transparent_skin_is_not_hit() -> None:
    scene = Scene(model_of(sleeve("clear", (0, 0, 1), 'rgba="1 1 1 0"')))
    scene.update(posed(scene.model))
    assert scene.cast((0, 0.1, 5), (0, 0, -1)).numpy().skin_id == -1


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_skin_with_a_lost_bone_is_not_hit_until_it_is_found(bad: float) -> None:
    model = model_of(sleeve("coat", (0, 0, 1), 'inflate="0.05"'))
    scene = Scene(model)
    data = posed(model)
    data.xpos[model.body("lower").id, 2] = bad
    with pytest.warns(RuntimeWarning, match="not hit: coat$") as caught:
        scene.update(data)
    assert len(caught) == 1
    below = scene.cast((0, 0.1, 5), (0, 0, -1)).numpy()
    assert below.skin_id == -1
    assert below.geom_id == model.geom("floor").id
    scene.update(posed(model))
    assert scene.cast((0, 0.1, 5), (0, 0, -1)).numpy().skin_id == 0
