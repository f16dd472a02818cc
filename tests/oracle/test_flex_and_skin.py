"""No ray at a moving flex or skin is wrong, near the origin and far from it, as mj_rayFlex and mju_raySkin judge.

A wrong ray is defined as for geoms, in rigcast.oracle.judge.
"""

import mujoco
import numpy as np
import pytest
from deformables import FLEXES, RAYS, SKINS, SOFT, Floats, moved, rays_towards, shifted, targets
from judged_casts import assert_none_wrong

import rigcast
from rigcast import oracle
from rigcast.oracle import RayHits, Verdict

pytestmark = pytest.mark.skipif(
    int(mujoco.__version__.split(".")[0]) < 4,
    reason="the oracles, mj_rayFlex on 3D flexes and mju_raySkin, cannot be called from Python before MuJoCo 4",
)

FAR = np.array((7e3, -7e3, 1e3))
STEPS = 3


def assert_moving_world_is_right(model: mujoco.MjModel, name: str, by: Floats) -> None:
    scene = rigcast.Scene(model)
    in_band, seen = 0, np.zeros(model.nflex + model.nskin, int)
    for k in range(STEPS):
        data = moved(model, 0, k)
        there = shifted(data, by)
        origins, directions = rays_towards(targets(model, data), 0, k)
        scene.update(there)
        hits = scene.cast(origins + by, directions).numpy()
        found = assert_none_wrong(model, there, origins + by, directions, hits, what=f"{name} at {by}, step {k}")
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
    found = assert_none_wrong(model, data, origins, directions, scene.cast(origins, directions).numpy())
    assert np.isfinite(found.expected.distance).all()
    assert oracle.Oracle(model, data).cast(origins, directions).geom_id.max() == -1, "mj_ray itself does not see flexes"


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
    """distance None: the answer has the oracle's distance, and its normal or the opposite one."""
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
