"""No ray is wrong in real models: the scenes that mujoco_warp ships with its tests, in several states, near and far.

Rays are those of `scenes.KINDS`: at random, towards and inside geoms, along axes, grazing faces, at vertices; and at
flexes. SDF geoms are judged by their meshes.
"""

import copy
import functools
import importlib.util
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
import scenes
from judged_casts import assert_none_wrong

import rigcast
from rigcast import oracle
from rigcast.oracle.deformable import CAN_JUDGE
from rigcast.oracle.ray import flat_rays


def _test_data() -> Path | None:
    """Return where mujoco_warp keeps its scenes; the package itself is not imported."""
    found = importlib.util.find_spec("mujoco_warp")
    return Path(str(found.origin)).parent / "test_data" if found else None


DATA = _test_data()
pytestmark = pytest.mark.skipif(
    DATA is None, reason="mujoco-warp, whose test scenes these are, is not installed (it needs a newer MuJoCo)"
)

STATES = 3
RAYS = 200  # of each kind in each state
STEPS = 40  # of simulation from one state of a model with flexes to the next
FAR = (1.0e4, 2.0e4)  # [m] from the origin


@functools.cache
def loaded(path: str) -> tuple[mujoco.MjModel, rigcast.Scene]:
    """Return a model, and a scene of it."""
    assert DATA is not None
    model = mujoco.MjModel.from_xml_path(str(DATA / path))
    return model, rigcast.Scene(model)


def state(model: mujoco.MjModel, seed: int, k: int) -> mujoco.MjData:
    """Return the initial state for k = 0; after that a keyframe, or where there is none a random state.

    A model with flexes is simulated instead: vertices moved at random would turn elements inside out.
    """
    data = mujoco.MjData(model)
    if model.nflex:
        mujoco.mj_step(model, data, STEPS * k)
    elif k == 0 or not model.nkey:
        return scenes.state(model, seed, k)
    else:
        mujoco.mj_resetDataKeyframe(model, data, (k - 1) % model.nkey)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_flex(model, data)
    return data


def moved_far(data: mujoco.MjData, seed: int) -> tuple[mujoco.MjData, scenes.Floats]:
    """Return a copy with everything moved by 10 to 20 km, and the vector (3,) of that move [m]."""
    rng = np.random.default_rng((seed, 3))
    by = rng.normal(size=3)
    by *= rng.uniform(*FAR) / np.linalg.norm(by)
    there = copy.copy(data)
    for places in (there.xpos, there.xipos, there.geom_xpos, there.flexvert_xpos):
        places += by
    return there, by


def rays_of(model: mujoco.MjModel, data: mujoco.MjData, seed: int, kind: str) -> tuple[scenes.Floats, scenes.Floats]:
    """Return (RAYS, 3) origins and directions of one of KINDS."""
    if kind != "flex":
        origins, directions = scenes.rays(model, data, seed, seed, kind)
        return origins[:RAYS], directions[:RAYS]
    rng = np.random.default_rng((seed, 4))
    vertices = data.flexvert_xpos
    targets = vertices[rng.integers(len(vertices), size=RAYS)] + 0.05 * rng.normal(size=(RAYS, 3))
    origins = vertices.mean(axis=0) + (2 * np.ptp(vertices, axis=0).max() + 0.1) * rng.normal(size=(RAYS, 3))
    return origins, targets - origins


def is_visible(model: mujoco.MjModel) -> npt.NDArray[np.bool_]:
    """Return (ngeom,) True for geoms that are not transparent."""
    material = model.geom_matid
    alpha: scenes.Floats = model.geom_rgba[:, 3].copy()
    alpha[material >= 0] = model.mat_rgba[material[material >= 0], 3]
    return alpha > 0


MODELS = [
    "aloha_pot/scene.xml",
    "hfield/hfield.xml",
    "humanoid/humanoid.xml",
    "humanoid/n_humanoid.xml",
    "mug/mug.xml",
    "primitives.xml",
    "convex_collision/box100.xml",
    "collision_sdf/cow.xml",
    "collision_sdf/mesh.xml",
    "collision_sdf/nutbolt.xml",
    "collision_sdf/tactile.xml",
    "collision.xml",
    "constraints.xml",
    "pendula.xml",
    "ray.xml",
]
FLEXES = ["flex/floppy.xml", "flex/moving_base_strain.xml", "flex/multiflex.xml", "flex/rope.xml"]
if CAN_JUDGE:
    MODELS += FLEXES


@pytest.mark.parametrize("path", MODELS)
@pytest.mark.parametrize("seed", range(STATES))
def test_no_ray_is_wrong(path: str, seed: int) -> None:
    model, scene = loaded(path)
    near = state(model, seed, seed)
    far, by = moved_far(near, seed)
    for data, offset in ((near, np.zeros(3)), (far, by)):
        scene.update(data)
        for kind in (*scenes.KINDS, "flex") if model.nflex else scenes.KINDS:
            origins, directions = rays_of(model, near, seed, kind)
            hits = scene.cast(origins + offset, directions).numpy()
            what = f"{path}, seed {seed}, {kind}, moved by {offset.tolist()}"
            assert_none_wrong(model, data, origins + offset, directions, hits, what=what)


@pytest.mark.parametrize("path", MODELS)
def test_the_rays_meet_every_type_of_the_model(path: str) -> None:
    """Else the test above would prove nothing."""
    model, _ = loaded(path)
    things = oracle.Things.of(model)
    expected = {things.types[geom] for geom in np.flatnonzero(is_visible(model))} | {*things.types[model.ngeom :]}
    hit: set[str] = set()
    for seed in range(STATES):
        data = state(model, seed, seed)
        for kind in ("towards", "flex") if model.nflex else ("towards",):
            got = oracle.World(model, data).cast(*flat_rays(*rays_of(model, data, seed, kind)))
            hit |= set(things.types_of(got.geom_id).tolist()) - {"none"}
    assert hit == expected
