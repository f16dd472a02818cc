"""Moving flexes and skins, and rays at them, as functions of a seed."""

import copy

import mujoco
import numpy as np
import numpy.typing as npt
import trimesh

Floats = npt.NDArray[np.float64]

RAYS = 1500

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


def skin_xml(name: str, bones: tuple[str, str], place: Floats, inflate: float, group: int) -> str:
    """Return the MJCF of a skin over two bones, whose bind poses are not their initial poses."""
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
    attributes = f'inflate="{inflate}" group="{group}" vertex="{numbers(vertices)}" face="{numbers(sleeve.faces)}"'
    return f'<skin name="{name}" {attributes}>{both}</skin>'


ARM = """<body name="{0}" pos="{1}"><freejoint/><geom size=".05"/>
<body name="{0}2" pos=".5 0 0"><joint type="ball"/><geom size=".05"/></body></body>"""
SKINS = f"""<worldbody>{ARM.format("a", "0 0 1")}{ARM.format("b", "0 1 1")}</worldbody><deformable>
{skin_xml("bare", ("a", "a2"), np.array((0.25, 0, 1)), 0, 0)}
{skin_xml("coat", ("b", "b2"), np.array((5.0, 3, 1)), 0.05, 4)}
</deformable>"""


def moved(model: mujoco.MjModel, seed: int, k: int) -> mujoco.MjData:
    """Return the k-th state: a wave in the flexes, so smooth that it turns no element inside out."""
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
    """Return the vertices (n, 3) of flexes, and of skins as MuJoCo's visualizer computes them."""
    scene, option = mujoco.MjvScene(model, 1000), mujoco.MjvOption()
    option.skingroup[:] = 1
    flags = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, option, None, mujoco.MjvCamera(), int(flags), scene)
    return np.concatenate([data.flexvert_xpos, np.array(scene.skinvert, float).reshape(-1, 3)])
