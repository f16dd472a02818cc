"""Flexes in a scene: the ids and faces of hits, filters, and flexes that are not finite."""

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
from judged_casts import assert_none_wrong
from small_scenes import assert_missed

from rigcast import DepthCamera, Filter, Mount, Rig, Scene
from rigcast.oracle.deformable import CAN_JUDGE

GRID = """<flexcomp name="{}" type="grid" count="{}" spacing="1 1 1" pos="{}" dim="{}" radius="0.1" mass="1" {}>
<edge equality="true"/>{}</flexcomp>"""
CLOTH = GRID.format("cloth", "3 3 1", "0 0 2", 2, 'group="1"', '<contact contype="0" conaffinity="0"/>')
ROPE = GRID.format("rope", "3 1 1", "0 5 2", 1, "", "")
CUBE = GRID.format("cube", "3 3 3", "0 -5 2", 3, "", "")
FLOOR = '<geom name="floor" type="plane" size="0 0 1"/>'
ABOVE = {"cloth": (0.5, 0.2, 9), "rope": (0.5, 5, 9), "cube": (0.5, -4.8, 9)}
IDS = {"cloth": 0, "rope": 1, "cube": 2}
TOP = {"cloth": 2.0, "rope": 2.1, "cube": 3.0}
UP = np.array((0, 0, 1))
DOWN = -UP


def model_of(world: str = FLOOR + CLOTH + ROPE + CUBE) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{world}</worldbody></mujoco>")


def posed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_flex(model, data)
    return data


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return model_of()


@pytest.fixture
def scene(model: mujoco.MjModel) -> Scene:
    made = Scene(model)
    made.update(posed(model))
    return made


@pytest.mark.parametrize("name", IDS)
def test_a_hit_names_its_flex_and_no_geom(scene: Scene, name: str) -> None:
    hit = scene.cast(ABOVE[name], DOWN).numpy()
    assert [int(i) for i in (hit.flex_id, hit.geom_id, hit.skin_id, hit.prop_id)] == [IDS[name], -1, -1, -1]
    assert hit.distance == pytest.approx(9 - TOP[name], abs=1e-5)
    np.testing.assert_allclose(hit.normal, UP, atol=1e-5)


def test_the_face_of_a_cloth_is_its_element_and_an_edge_has_none(model: mujoco.MjModel, scene: Scene) -> None:
    data = posed(model)
    elements = model.flex_elem[: 3 * model.flex_elemnum[0]].reshape(-1, 3)
    corners = data.flexvert_xpos[elements]
    hits = scene.cast(corners.mean(axis=1) + UP, [DOWN] * len(corners)).numpy()
    np.testing.assert_array_equal(hits.face, np.arange(len(corners)))
    edges = scene.cast(corners[:, :2].mean(axis=1) + UP, [DOWN] * len(corners)).numpy()
    np.testing.assert_array_equal(edges.face, -1)
    np.testing.assert_allclose(edges.distance, 0.9, atol=1e-5)


@pytest.mark.parametrize(("z", "direction"), [(9, DOWN), (1, UP)], ids=["above", "below"])
def test_both_sides_of_a_cloth_are_outer_sides(scene: Scene, z: float, direction: npt.NDArray[np.int_]) -> None:
    for cull in ("none", "back"):
        hit = scene.cast((0.5, 0.2, z), direction, cull=cull).numpy()
        assert hit.flex_id == 0
        np.testing.assert_allclose(hit.normal, -direction, atol=1e-5)
    assert scene.cast((0.5, 0.2, z), direction, cull="front").numpy().flex_id == -1


SEEN = [
    (Filter(), {"cloth", "rope", "cube"}),
    (Filter(geom_groups=[1]), {"cloth"}),
    (Filter(geom_groups=[0, 2]), {"rope", "cube"}),
    (Filter(geometry="visual"), {"cloth"}),
    (Filter(geometry="collision"), {"rope", "cube"}),
    (Filter(static=False), {"cloth", "rope", "cube"}),
    (Filter(exclude_bodies=["cloth_0"]), {"cloth", "rope", "cube"}),
    (Filter(exclude_bodies=[f"rope_{k}" for k in range(3)]), {"cloth", "cube"}),
    (Filter(exclude_bodies=["world"], exclude_subtree=True), set()),
]


@pytest.mark.parametrize(
    ("filter", "expected"),
    SEEN,
    ids=lambda value: " ".join(sorted(value)) if isinstance(value, set) else str(value)[:60],
)
def test_a_filter_treats_flexes_as_it_treats_geoms(scene: Scene, filter: Filter, expected: set[str]) -> None:
    seen = {name for name, origin in ABOVE.items() if scene.cast(origin, DOWN, filter=filter).numpy().flex_id >= 0}
    assert seen == expected


def test_a_pinned_flex_is_static_and_a_transparent_one_is_not_hit() -> None:
    still = GRID.format("still", "3 3 1", "0 0 2", 2, 'rigid="true"', "")
    clear = GRID.format("clear", "3 3 1", "0 0 3", 2, 'rgba="1 1 1 0"', "")
    scene = Scene(model_of(still + clear))
    scene.update(posed(scene.model))
    assert scene.cast(ABOVE["cloth"], DOWN).numpy().flex_id == 0
    assert_missed(scene.cast(ABOVE["cloth"], DOWN, filter=Filter(static=False)).numpy())


@pytest.mark.skipif(not CAN_JUDGE, reason="this MuJoCo cannot say what rays hit of flexes")
def test_normals_of_a_soft_body_that_is_inside_out_point_outward_and_so_again_when_it_is_not() -> None:
    """Else `cull` would drop the wrong side."""
    model = model_of(CUBE)
    data, scene, seed = posed(model), Scene(model), 1
    directions = np.random.default_rng(seed).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    as_it_was = data.flexvert_xpos.copy()
    for factor in (-1.0, 1.0):
        data.flexvert_xpos[...] = as_it_was * (factor, 1, 1)
        origins = data.flexvert_xpos.mean(axis=0) - 9 * directions
        scene.update(data)
        hits = scene.cast(origins, directions, cull="back").numpy()
        found = assert_none_wrong(model, data, origins, directions, hits, what=f"seed {seed}, factor {factor}")
        assert (found.got.geom_id >= 0).all(), f"seed {seed}, factor {factor}"


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e30])
@pytest.mark.parametrize("name", IDS)
def test_a_flex_with_a_lost_vertex_is_not_hit_and_corrupts_no_other(
    model: mujoco.MjModel, scene: Scene, name: str, bad: float
) -> None:
    rays = list(ABOVE.values()), [DOWN] * 3
    good = scene.cast(*rays).numpy()
    data = posed(model)
    data.flexvert_xpos[model.flex_vertadr[IDS[name]] + 1, 1] = bad
    with pytest.warns(RuntimeWarning, match=f"not hit: {name}$") as caught:
        scene.update(data)
    scene.update(data)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    hits = scene.cast(*rays).numpy()
    expected = np.array([-1 if k == name else IDS[k] for k in ABOVE])
    np.testing.assert_array_equal(hits.flex_id, expected)
    np.testing.assert_array_equal(hits.geom_id, np.where(expected < 0, 0, -1))
    np.testing.assert_array_equal(hits.distance[expected >= 0], good.distance[expected >= 0])
    scene.update(posed(model))
    np.testing.assert_array_equal(scene.cast(*rays).numpy().distance, good.distance)


def test_a_radius_that_changes_is_seen_at_the_next_update() -> None:
    scene = Scene(model_of(ROPE))
    data = posed(scene.model)
    scene.update(data)
    scene.model.flex_radius[0] = 0.25
    scene.update(data)
    assert scene.cast((0.5, 5, 9), DOWN).numpy().distance == pytest.approx(6.75, abs=1e-5)


def test_a_rig_sees_flexes_at_the_time_of_the_data() -> None:
    model = model_of(CLOTH)
    sensor = DepthCamera(name="up", mount=Mount(euler_deg=(0, -90, 0)), resolution=(9, 9), fov_y_deg=60)
    rig, scene = Rig(model, [sensor]), Scene(model)
    data, now = posed(model), mujoco.MjData(model)
    for _ in range(50):
        mujoco.mj_step(model, data)
    seen = rig.cast(data)["up"].numpy()
    now.qpos[:] = data.qpos
    rays = rig.rays(data)["up"]
    for state, is_same in ((data, False), (now, True)):
        if state is now:
            mujoco.mj_kinematics(model, now)
            mujoco.mj_comPos(model, now)
            mujoco.mj_flex(model, now)
        scene.update(state)
        distance = scene.cast(rays.origins, rays.directions).numpy().distance
        assert (seen.flex_id == 0).any()
        assert (np.abs(distance - seen.distance)[seen.flex_id == 0].max() < 1e-6) == is_same
