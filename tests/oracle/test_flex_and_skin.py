"""No ray at a flex or skin is wrong while they move, near the origin and far: judged by mj_rayFlex and mju_raySkin.

The one definition of a wrong ray (rigcast.oracle.judge) holds for them as for geoms.
"""

import copy

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
import trimesh

import rigcast
from rigcast import oracle
from rigcast.oracle import RayHits, Verdict
from rigcast.oracle.deformable import CAN_JUDGE
from rigcast.oracle.ray import Floats

pytestmark = pytest.mark.skipif(
    not CAN_JUDGE,
    reason="the oracles, mj_rayFlex on 3D flexes and mju_raySkin, cannot be called from Python before MuJoCo 4",
)

FAR = np.array((7e3, -7e3, 1e3))
RAYS = 1500
STEPS = 3

EDGE = '<edge equality="true"/>'
GRID = '<flexcomp name="{}" type="grid" count="{}" spacing=".2 .2 .2" pos="{}" dim="{}" radius="{}" mass="1">'
ROPE = GRID.format("rope", "8 1 1", "0 1.5 1", 1, 0.03) + EDGE + "</flexcomp>"
CLOTH = GRID.format("cloth", "6 5 1", "0 0 1", 2, 0.02) + EDGE + "</flexcomp>"
PINNED = GRID.format("pinned", "4 4 1", "0 -1.5 1", 2, 0.001) + EDGE + '<pin id="0 3"/></flexcomp>'
SOFT = GRID.format("soft", "4 4 5", "2 0 1", 3, 0.02) + EDGE + "</flexcomp>"
JELLY = """<flexcomp name="jelly" type="grid" count="4 4 4" spacing=".1 .1 .1" pos="2 2 1" dim="3" radius=".01"
mass="1" dof="trilinear"><edge equality="strain"/></flexcomp>"""
BOARD = """<body name="board" pos="-2 0 1"><freejoint/><geom size=".1"/>
<flexcomp name="board" type="grid" count="4 4 1" spacing=".2 .2 .2" dim="2" radius=".03" rigid="true"/></body>"""
FLOOR = '<geom name="floor" type="plane" size="0 0 1" pos="0 0 -1"/><geom size=".3" pos="0 0 .5"/>'
FLEXES = {
    "rope": ROPE,
    "cloth": CLOTH,
    "soft": SOFT,
    "jelly": JELLY,
    "all": ROPE + CLOTH + PINNED + SOFT + JELLY + BOARD + FLOOR,
}


def numbers(values: npt.ArrayLike) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(values))


def skin_xml(name: str, bones: tuple[str, str], place: Floats, inflate: float) -> str:
    """Return a sleeve over two bones, bound in poses other than those in which they start."""
    sleeve = trimesh.creation.icosphere(2)
    vertices = sleeve.vertices * (0.5, 0.2, 0.2) + place
    weight = np.clip(vertices[:, 0] - place[0] + 0.5, 0, 1)
    bone = '<bone body="{}" bindpos="{}" bindquat="{}" vertid="{}" vertweight="{}"/>'
    both = "".join(
        bone.format(body, numbers(place + shift), turn, numbers(np.flatnonzero(w)), numbers(w[w > 0]))
        for body, shift, turn, w in zip(
            bones, ([-0.2, 0, 0], [0.3, 0, 0]), ("1 0 0 0", ".8 .6 0 0"), (1 - weight, weight), strict=True
        )
    )
    attributes = f'inflate="{inflate}" vertex="{numbers(vertices)}" face="{numbers(sleeve.faces)}"'
    return f'<skin name="{name}" {attributes}>{both}</skin>'


ARM = """<body name="{0}" pos="{1}"><freejoint/><geom size=".05"/>
<body name="{0}2" pos=".5 0 0"><joint type="ball"/><geom size=".05"/></body></body>"""
SKINS = f"""<worldbody>{ARM.format("a", "0 0 1")}{ARM.format("b", "0 1 1")}</worldbody><deformable>
{skin_xml("bare", ("a", "a2"), np.array((0.25, 0, 1)), 0)}{skin_xml("coat", ("b", "b2"), np.array((5.0, 3, 1)), 0.05)}
</deformable>"""


def moved(model: mujoco.MjModel, seed: int, k: int) -> mujoco.MjData:
    """Return the k-th state: a wave runs through the flexes, smooth enough to turn no element inside out."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    velocity = np.random.default_rng((seed, k)).normal(size=model.nv)
    slides = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    wave = np.sin(3 * np.roll(data.xpos[model.jnt_bodyid], 1, axis=1) + k)
    velocity[model.jnt_dofadr[slides]] = (wave * model.jnt_axis).sum(axis=1)[slides]
    mujoco.mj_integratePos(model, data.qpos, velocity, 0.2)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_flex(model, data)
    return data


def shifted(data: mujoco.MjData, by: Floats) -> mujoco.MjData:
    there = copy.copy(data)
    for places in (there.xpos, there.xipos, there.geom_xpos, there.flexvert_xpos):
        places += by
    return there


def rays_towards(targets: Floats, seed: int, k: int) -> tuple[Floats, Floats]:
    """Return rays from around the targets (n, 3) to places near them."""
    rng = np.random.default_rng((seed, 5, k))
    chosen = targets[rng.integers(len(targets), size=RAYS)] + 0.06 * rng.normal(size=(RAYS, 3))
    outwards = rng.normal(size=(RAYS, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    reach = np.linalg.norm(np.ptp(targets, axis=0)) + 0.2
    origins = targets.mean(axis=0) + reach * rng.uniform(1, 3, (RAYS, 1)) * outwards
    directions = chosen - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def targets(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return (n, 3) vertices of flexes and skins, as MuJoCo's visualizer computes these."""
    scene = mujoco.MjvScene(model, 1000)
    flags = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), int(flags), scene)
    return np.concatenate([data.flexvert_xpos, np.array(scene.skinvert, float).reshape(-1, 3)])


def assert_moving_world_is_right(model: mujoco.MjModel, name: str, by: Floats) -> None:
    scene = rigcast.Scene(model)
    in_band, seen = 0, np.zeros(model.nflex + model.nskin, int)
    for k in range(STEPS):
        data = moved(model, 0, k)
        there = shifted(data, by)
        origins, directions = rays_towards(targets(model, data), 0, k)
        scene.update(there)
        hits = scene.cast(origins + by, directions).numpy()
        found = oracle.compare(model, there, origins + by, directions, hits)
        wrong = found.where(Verdict.WRONG)
        assert not wrong.size, (
            f"{name} at {by}, step {k}: {wrong.size} wrong, first ray {wrong[0]}: "
            f"origin {(origins + by)[wrong[0]].tolist()}, direction {directions[wrong[0]].tolist()}\n"
            f"got {found.got.take(wrong[0])}\nexpected {found.expected.take(wrong[0])}"
        )
        in_band += len(found.where(Verdict.EDGE))
        met = found.things()
        seen += np.bincount(met[met >= model.ngeom] - model.ngeom, minlength=len(seen))
    assert in_band <= 1e-3 * STEPS * RAYS, f"{in_band} rays in the edge band"
    assert (seen > 0.05 * STEPS * RAYS / len(seen)).all(), f"hits of each: {seen}"


@pytest.mark.parametrize("by", [np.zeros(3), FAR], ids=["near", "10 km away"])
@pytest.mark.parametrize("name", FLEXES)
def test_no_ray_at_a_moving_flex_is_wrong(name: str, by: Floats) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{FLEXES[name]}</worldbody></mujoco>")
    assert_moving_world_is_right(model, name, by)


@pytest.mark.parametrize("by", [np.zeros(3), FAR], ids=["near", "10 km away"])
def test_no_ray_at_a_moving_skin_is_wrong(by: Floats) -> None:
    assert_moving_world_is_right(mujoco.MjModel.from_xml_string(f"<mujoco>{SKINS}</mujoco>"), "skins", by)


def test_no_ray_from_inside_a_soft_body_is_wrong() -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{SOFT}</worldbody></mujoco>")
    data = moved(model, 1, 1)
    scene = rigcast.Scene(model)
    scene.update(data)
    rng = np.random.default_rng(1)
    origins = data.flexvert_xpos.mean(axis=0) + rng.uniform(-0.2, 0.2, (500, 3))
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = oracle.compare(model, data, origins, directions, scene.cast(origins, directions).numpy())
    assert np.isfinite(found.expected.distance).all()
    assert not found.where(Verdict.WRONG).size
    assert oracle.cast(model, data, origins, directions).geom_id.max() == -1, "mj_ray itself does not see flexes"


# Two tetrahedra with a common side in the plane x = 0, the tip of one at x = 1, of the other at x = -1.
PAIR = """<flexcomp name="pair" type="direct" dim="3" radius="1e-4" mass="1" point="0 -1 -1 0 1 -1 0 0 1 1 0 0 -1 0 0"
element="0 1 2 3 0 2 1 4"><edge equality="true"/></flexcomp>"""
ALONG = (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("start", "distance", "normal", "verdict"),
    [
        pytest.param(-0.3, 0.3, (1, 0, 0), Verdict.AGREE, id="where two elements meet, out of the first"),
        pytest.param(-0.3, 0.3, (-1, 0, 0), Verdict.AGREE, id="where two elements meet, out of the other"),
        pytest.param(-0.3, 0.3, (0, 0, 1), Verdict.WRONG, id="where two elements meet, another normal"),
        pytest.param(-0.3, 0.31, (1, 0, 0), Verdict.WRONG, id="where two elements meet, too far"),
        pytest.param(-3.0, None, (-1, 0, 0), Verdict.AGREE, id="outer side"),
        pytest.param(-3.0, None, (1, 0, 0), Verdict.WRONG, id="outer side, normal flipped"),
        pytest.param(0.3, None, (1, 0, 0), Verdict.AGREE, id="outer side from inside"),
        pytest.param(0.3, None, (-1, 0, 0), Verdict.WRONG, id="outer side from inside, normal flipped"),
    ],
)
def test_either_element_counts_only_where_two_meet(
    start: float, distance: float | None, normal: tuple[float, float, float], verdict: Verdict
) -> None:
    """distance None: the oracle's, and a normal along it or against it."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{PAIR}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    origin, direction = np.array([[start, -0.1, -0.2]]), np.array([ALONG])
    expected = oracle.World(model, data).cast(origin, direction)
    if distance is None:
        side = np.sign(normal[0]) * np.sign(expected.normal[0, 0])
        answer = expected._replace(normal=side * expected.normal)
        assert np.sign(expected.normal[0, 0]) == np.sign(start)
        assert np.isfinite(expected.distance[0])
    else:
        answer = RayHits(np.array([distance]), np.zeros(1, np.int32), np.array([normal], float))
    found = oracle.compare(model, data, origin, direction, answer)
    assert Verdict(found.verdict[0]) == verdict, f"got {answer}, expected {found.expected}"
