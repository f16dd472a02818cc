"""A scene casts rays against the poses of the last update."""

import itertools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
import small_scenes
import warp as wp
from small_scenes import KINDS, assert_missed, model_of, posed, ready

from rigcast import Filter, Scene


@pytest.fixture(scope="module")
def row() -> Scene:
    return small_scenes.row()


@pytest.mark.parametrize("shape", [(), (1,), (7,), (3, 4), (2, 3, 4), (0,), (0, 3)], ids=str)
@pytest.mark.parametrize("shares_origin", [True, False])
def test_hits_have_the_shape_of_the_rays(row: Scene, shape: tuple[int, ...], shares_origin: bool) -> None:
    directions = np.broadcast_to([1.0, 0, 0], (*shape, 3))
    origins = np.zeros(3) if shares_origin else np.zeros((*shape, 3))
    hits = row.cast(origins, directions)
    values = hits.numpy()
    for name, tail, dtype in (
        ("distance", (), "f4"),
        ("geom_id", (), "i4"),
        ("face", (), "i4"),
        ("normal", (3,), "f4"),
    ):
        value = getattr(values, name)
        assert (value.shape, value.dtype) == ((*shape, *tail), np.dtype(dtype)), name
        assert tuple(getattr(hits, name).shape) == ((*(shape or (1,)), *tail)), name
    np.testing.assert_allclose(values.distance, 0.9, atol=1e-6)
    np.testing.assert_array_equal(values.geom_id, 0)
    np.testing.assert_array_equal(values.face, -1)
    np.testing.assert_allclose(values.normal, np.broadcast_to([-1, 0, 0], (*shape, 3)), atol=1e-6)


def test_every_ray_leaves_from_its_own_origin(row: Scene) -> None:
    origins = np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0], [6, 0, 0]], float).reshape(2, 2, 3)
    distance = row.cast(origins, np.broadcast_to([1.0, 0, 0], (2, 2, 3))).numpy().distance
    np.testing.assert_allclose(distance, [[0.9, 0.9], [0.9, np.inf]], atol=1e-6)


@pytest.mark.parametrize("on_device", [(False, False), (True, True), (False, True)], ids=str)
@pytest.mark.parametrize(
    ("origins", "directions"),
    [((5,), ()), ((1,), (5,)), ((5,), (1,)), ((2, 5), (5,)), ((2, 1), (5,)), ((1, 1), (5,)), ((0,), ()), ((), ())],
    ids=str,
)
def test_origins_and_directions_are_broadcast(
    row: Scene, origins: tuple[int, ...], directions: tuple[int, ...], on_device: tuple[bool, bool]
) -> None:
    rng = np.random.default_rng(3)
    starts = rng.uniform(-0.05, 0.05, (*origins, 3))
    aims = rng.uniform([0.9, -0.03, -0.03], [1.1, 0.03, 0.03], (*directions, 3))
    shape = np.broadcast_shapes(starts.shape, aims.shape)
    expected = row.cast(np.broadcast_to(starts, shape).copy(), np.broadcast_to(aims, shape).copy()).numpy()
    rays: Any = [
        wp.array(vectors.reshape(-1 if not vectors.shape[:-1] else vectors.shape), dtype=wp.vec3d, device=row.device)
        if there
        else vectors
        for vectors, there in zip((starts, aims), on_device, strict=True)
    ]
    hits = row.cast(*rays).numpy()
    assert hits.distance.shape == (shape[:-1] if shape[:-1] or not on_device[1] else (1,))
    for name in ("distance", "geom_id", "normal"):
        found, same = getattr(hits, name), getattr(expected, name)
        np.testing.assert_array_equal(found.reshape(same.shape), same, err_msg=name)
    assert np.isfinite(hits.distance).all()


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64, np.uint8, list, tuple])
def test_rays_may_be_any_array_like(row: Scene, kind: Any) -> None:
    rays = np.array([[1, 0, 0], [0, 1, 0]])
    directions = rays.tolist() if kind is list else tuple(map(tuple, rays)) if kind is tuple else rays.astype(kind)
    np.testing.assert_allclose(row.cast((0, 0, 0), directions).numpy().distance, [0.9, np.inf], atol=1e-6)


def test_a_view_with_strides_is_read_as_it_stands(row: Scene) -> None:
    rays = np.zeros((3, 8))[:, ::2].T  # (4, 3), not contiguous
    rays[:, 0], rays[2] = 1, (0, 0, 1)
    np.testing.assert_allclose(row.cast((0, 0, 0), rays).numpy().distance, [0.9, 0.9, np.inf, 0.9], atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("as_warp", [False, True])
def test_rays_of_any_length_that_are_cast_together_are_each_as_alone(row: Scene, seed: int, as_warp: bool) -> None:
    rng = np.random.default_rng(seed)
    count = 1300  # more than a thread takes at a time
    origins: Any = rng.normal(0.0, 2.0, (count, 3))
    aims = rng.choice([1.0, 3.0, 5.0], (count, 1)) * [1, 0, 0] + rng.normal(0.0, 0.07, (count, 3))
    directions: Any = (aims - origins) * 10.0 ** rng.uniform(-100, 100, (count, 1))
    some = rng.choice(count, 40)
    alone = [row.cast(origins[i], directions[i]).numpy() for i in some]
    if as_warp:
        origins, directions = (wp.array(a, dtype=wp.vec3d, device=row.device) for a in (origins, directions))
    hits = row.cast(origins, directions).numpy()
    assert set(hits.geom_id[some]) == {-1, 0, 1, 2}, seed
    for name in ("distance", "geom_id", "normal"):
        got, expected = getattr(hits, name)[some], [getattr(each, name) for each in alone]
        np.testing.assert_array_equal(got, expected, err_msg=f"{name}, seed {seed}")


@pytest.mark.parametrize("dtype", [wp.vec3, wp.vec3d])
@pytest.mark.parametrize(
    "view",
    [
        lambda a: a.flatten()[::3],
        lambda a: a[::2],
        lambda a: a[:, 1],
        lambda a: a[1:5, ::2],
        lambda a: a.transpose((1, 0)),
    ],
    ids=["every third", "rows", "column", "block", "transposed"],
)
def test_warp_arrays_with_gaps_are_the_rays_that_they_hold(row: Scene, dtype: type, view: Callable[[Any], Any]) -> None:
    rng = np.random.default_rng(0)
    aims, starts = rng.choice([-1.0, 1.0], (6, 4, 1)) * (1, 0.03, 0.03), rng.normal(0.0, 0.03, (6, 4, 3))
    directions, origins = (view(wp.array(vectors, dtype=dtype, device=row.device)) for vectors in (aims, starts))
    hits, expected = row.cast(origins, directions).numpy(), row.cast(origins.numpy(), directions.numpy()).numpy()
    assert hits.distance.shape == directions.shape
    assert set(expected.geom_id.ravel()) > {-1}
    for name in ("distance", "geom_id", "normal"):
        np.testing.assert_array_equal(getattr(hits, name), getattr(expected, name), err_msg=name)


def test_rays_may_be_on_the_host_and_their_origins_not(row: Scene) -> None:
    origins, directions = [[0, 0, 0], [2, 0, 0], [6, 0, 0]], np.tile([1.0, 0, 0], (3, 1))
    hits = row.cast(wp.array(origins, dtype=wp.vec3d, device=row.device), directions).numpy()
    np.testing.assert_array_equal(hits.distance, row.cast(origins, directions).numpy().distance)


@pytest.mark.parametrize("as_warp", [False, True])
def test_origins_far_away_keep_float64(as_warp: bool) -> None:
    scene = ready(model_of('<geom size="0.1" pos="1000001 -1000000 1000000"/>'))
    origins: Any = np.array([[1e6 + gap, -1e6, 1e6 + 0.05] for gap in (0, 0.123, 0.456, 0.8)])
    directions: Any = np.tile([1.0, 0, 0], (4, 1))
    if as_warp:
        origins, directions = (wp.array(v, dtype=wp.vec3d, device=scene.device) for v in (origins, directions))
    half_chord = np.sqrt(0.1**2 - 0.05**2)
    expected = np.array([1, 0.877, 0.544, 0.2]) - half_chord
    np.testing.assert_allclose(scene.cast(origins, directions).numpy().distance, expected, atol=1e-6)


MISS = np.array([0, 0, 1.0])


def test_a_miss_is_infinitely_far_and_has_no_geom_face_or_normal(row: Scene) -> None:
    assert_missed(row.cast((0, 0, 0), MISS).numpy())
    assert_missed(row.cast((0, 0, 0), np.tile(MISS, (5, 1))).numpy())
    assert_missed(ready(model_of("")).cast((0, 0, 0), [[1, 0, 0], [0, 0, -1]]).numpy())


@pytest.mark.parametrize("kind", KINDS)
def test_max_distance_is_inclusive(kind: str) -> None:
    scene = ready(model_of(f"<geom {KINDS[kind].format(y=0)}/>"))
    origin, forward = (0, 0, -0.125), (1000.0, 0, 0)
    distance = scene.cast(origin, forward).numpy().distance
    assert distance == pytest.approx(2, abs=0.05)
    for reach in (distance, np.nextafter(distance, np.float32(np.inf)), np.inf):
        assert scene.cast(origin, forward, max_distance=float(reach)).numpy().distance == distance
    for reach in (np.nextafter(distance, np.float32(0)), 1.0, 0.0):
        assert_missed(scene.cast(origin, forward, max_distance=float(reach)).numpy())


def test_only_what_lies_beyond_max_distance_is_missed(row: Scene) -> None:
    hits = row.cast((2, 0, 0), [(1, 0, 0), (-1, 0, 0)], max_distance=0.95).numpy()
    assert hits.geom_id.tolist() == [1, 0]
    hits = row.cast([(0, 0, 0), (2.5, 0, 0)], [(1, 0, 0), (1, 0, 0)], max_distance=0.5).numpy()
    assert hits.geom_id.tolist() == [-1, 1]


@pytest.mark.parametrize("mesh", ["cube", "tent"])
def test_mesh_faces_are_mujocos(mesh: str) -> None:
    model = model_of(
        '<geom type="mesh" mesh="tent" pos="0 0 -30"/><geom type="mesh" mesh="cube" pos="0 0 30"/>'
        f'<geom name="it" type="mesh" mesh="{mesh}" pos="1 2 3" euler="20 30 40"/>'
    )
    data, asset, geom = posed(model), model.mesh(mesh), model.geom("it").id
    vertices = model.mesh_vert[asset.vertadr[0] :][: asset.vertnum[0]] @ data.geom_xmat[geom].reshape(3, 3).T
    corners = (vertices + data.geom_xpos[geom])[model.mesh_face[asset.faceadr[0] :][: asset.facenum[0]]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    hits = ready(model).cast(corners.mean(axis=1) + 0.5 * normals, -normals).numpy()
    np.testing.assert_array_equal(hits.face, np.arange(len(corners)))
    np.testing.assert_array_equal(hits.geom_id, geom)
    np.testing.assert_allclose(hits.normal, normals, atol=1e-5)
    np.testing.assert_allclose(hits.distance, 0.5, atol=1e-5)


def test_height_field_faces_count_cells_row_by_row() -> None:
    scene = ready(model_of('<geom type="hfield" hfield="hill"/>'))
    cells = [
        ((c + u) / 3 * 2 - 1, (r + v) - 1, 5.0) for r in range(2) for c in range(3) for u, v in ((0.7, 0.3), (0.3, 0.7))
    ]
    hits = scene.cast(cells, np.tile([0.0, 0, -1], (12, 1))).numpy()
    np.testing.assert_array_equal(hits.face, np.arange(12))


MOVERS = """
<geom type="plane" size="0 0 1" pos="0 0 -20"/>
<body name="car" pos="4 0 0"><joint type="slide" axis="1 0 0"/><joint type="hinge" axis="0 0 1"/>
  <geom type="box" size="0.5 1 0.5"/><geom type="mesh" mesh="tent" pos="0 0 1" contype="0" conaffinity="0"/></body>
<body name="ball" pos="0 4 0"><freejoint/><geom size="1"/></body>
<body name="door" mocap="true" pos="-4 0 0"><geom type="cylinder" size="0.5 1"/></body>
<geom type="hfield" hfield="hill" pos="0 -4 0"/>
"""


def moved(model: mujoco.MjModel, seed: int) -> mujoco.MjData:
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    data.qpos[:] += rng.normal(scale=10.0 ** rng.integers(-2, 3), size=model.nq)
    data.mocap_pos[:] += rng.normal(size=(model.nmocap, 3))
    mujoco.mj_kinematics(model, data)
    return data


def test_moving_geoms_are_seen_where_they_are_after_every_update() -> None:
    model = model_of(MOVERS)
    scene = Scene(model)
    for seed in range(30):
        data = moved(model, seed)
        scene.update(data)
        for geom in range(1, model.ngeom):
            target = data.geom_xpos[geom] + np.array([0.01, -0.02, 0.03])
            origin = target + np.random.default_rng((seed, geom)).normal(scale=5, size=3)
            found, normal = np.zeros(1, np.int32), np.zeros(3)
            distance = mujoco.mj_ray(model, data, origin, target - origin, None, 1, -1, found, normal)
            hits = scene.cast(origin, target - origin).numpy()
            where = f"seed {seed}, geom {geom}"
            assert hits.geom_id == found[0], where
            expected = distance * np.linalg.norm(target - origin)
            assert hits.distance == pytest.approx(expected, rel=1e-5, abs=1e-5), where
            np.testing.assert_allclose(hits.normal, normal, atol=2e-3, err_msg=where)


def test_poses_are_those_of_the_last_update_and_hits_stay_as_they_were() -> None:
    model = model_of(MOVERS)
    data, scene = posed(model), Scene(model)
    scene.update(data)
    before = scene.cast((0, 0, 0), (1, 0, 0))
    data.qpos[0] += 2
    mujoco.mj_kinematics(model, data)
    assert scene.cast((0, 0, 0), (1, 0, 0)).numpy().distance == np.float32(3.5)
    scene.update(data)
    assert scene.cast((0, 0, 0), (1, 0, 0)).numpy().distance == np.float32(5.5)
    assert before.numpy().distance == np.float32(3.5)


def test_an_update_takes_geom_poses_as_they_stand() -> None:
    model = model_of(MOVERS)
    data, scene = posed(model), Scene(model)
    data.qpos[0] += 2  # and no mj_kinematics
    scene.update(data)
    assert scene.cast((0, 0, 0), (1, 0, 0)).numpy().distance == np.float32(3.5)


def test_filters_share_one_scene(row: Scene) -> None:
    filters = {
        None: 0.9,
        Filter(): 0.9,
        Filter(geom_groups=[1]): 2.9,
        Filter(static=False): 4.9,
        Filter(exclude_bodies=["world"]): 4.9,
        Filter(exclude_bodies=["third"], geom_groups=[1, 2]): 2.9,
        Filter(geometry="visual"): np.inf,
    }
    for filter_, expected in itertools.chain(filters.items(), reversed(filters.items())):
        assert row.cast((0, 0, 0), (1, 0, 0), filter=filter_).numpy().distance == np.float32(expected), filter_


def test_culling_drops_the_side_it_names(row: Scene) -> None:
    for cull, expected in (("none", (0.9, 0.1)), ("back", (0.9, 1.9)), ("front", (1.1, 0.1))):
        hits = row.cast([(0, 0, 0), (1, 0, 0)], [(1, 0, 0), (1, 0, 0)], cull=cull).numpy()  # type: ignore[arg-type]
        np.testing.assert_allclose(hits.distance, expected, atol=1e-6, err_msg=cull)
        assert (hits.normal[:, 0] < 0).tolist() == {"none": [True, False], "back": [True] * 2, "front": [False] * 2}[
            cull
        ]


@pytest.mark.parametrize("dtype", [wp.vec3, wp.vec3d])
def test_device_rays_that_are_not_finite_give_nan(row: Scene, dtype: Any) -> None:
    nan, inf = np.nan, np.inf
    origins = [(0, 0, 0), (nan, 0, 0), (0, inf, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), (2, 0, 0)]
    directions = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, nan, 0), (inf, 0, 0), (0, 0, 0), (0, 0, 1), (9, 0, 0)]
    rays = [wp.array(np.array(v).reshape(2, 4, 3), dtype=dtype, device=row.device) for v in (origins, directions)]
    hits = row.cast(*rays).numpy()
    expected = np.array([0.9, nan, nan, nan, nan, nan, inf, 0.9]).reshape(2, 4)
    np.testing.assert_allclose(hits.distance, expected, atol=1e-6)
    np.testing.assert_array_equal(hits.geom_id.ravel(), [0, -1, -1, -1, -1, -1, -1, 1])
    np.testing.assert_array_equal(hits.normal[~np.isfinite(hits.distance)], 0)
    np.testing.assert_array_equal(hits.face, -1)


@pytest.mark.parametrize("dtype", [wp.vec3, wp.vec3d])
@pytest.mark.parametrize("shape", [None, (1,), (3, 5)], ids=["on the host", "one", "one per ray"])
def test_device_rays_are_cast_as_host_rays_are(row: Scene, dtype: Any, shape: tuple[int, ...] | None) -> None:
    directions = np.random.default_rng(4).normal(scale=(1, 0.03, 0.03), size=(3, 5, 3)).astype(np.float32)
    expected = row.cast((0.5, 0, 0), directions).numpy()
    origins = np.broadcast_to(np.array((0.5, 0, 0)), (*(shape or ()), 3))
    on_device = origins if shape is None else wp.array(origins, dtype=dtype, device=row.device)
    got = row.cast(on_device, wp.array(directions, dtype=dtype, device=row.device)).numpy()
    assert 0 < (expected.geom_id >= 0).sum() < 15
    np.testing.assert_array_equal(got.geom_id, expected.geom_id)
    np.testing.assert_allclose(got.distance, expected.distance, rtol=1e-5)
