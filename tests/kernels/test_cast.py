"""The cast: trees lose no hit, and the hits of ties, limits and rays that are not finite are defined."""

import numpy as np
import pytest
import warp as wp
from made_worlds import (
    Doubles,
    Hits,
    Mesh,
    Plan,
    assert_same,
    cast_through,
    cube,
    grid,
    icosphere,
    random_plan,
    random_rays,
    random_rotations,
    torus,
    turned,
    unit,
)
from moeller_trumbore import dot, moeller_trumbore, norm

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.launching import slices
from rigcast.kernels.rays.unit import unit_directions
from rigcast.kernels.shapes.solids import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE, SPHERE
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE

INF = np.inf


# ---- against exhaustive search


def all_triangles(origins: Doubles, directions: Doubles, corners: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Distance t, least barycentric coordinate and |cos|, (rays, triangles) each, in float64."""
    v0, v1, v2 = np.moveaxis(corners, 1, 0)
    t, weights = moeller_trumbore(origins[:, None], directions[:, None], v0, v1, v2)
    n = np.cross(v1 - v0, v2 - v0)
    t = np.where(np.abs(t) < 1e6, t, -1.0)  # nearly parallel
    return t, weights.min(axis=-1), np.abs(directions @ (n / norm(n)[:, None]).T)


@pytest.mark.parametrize("seed", range(4))
def test_nearest_of_all_triangles_is_hit(seed: int) -> None:
    """The nearest that is surely hit, or a nearer one whose edge the ray passes within 1e-5 of its size."""
    rng = np.random.default_rng(seed)
    plan = Plan()
    shapes: list[tuple[Mesh, int]] = [
        (icosphere(2), 3),
        (torus(), 2),
        (turned(grid(8, 0.2, seed), seed), 2),
        (cube(), 3),
    ]
    corners, owner, face = [], [], []
    for k, (shape, instances) in enumerate(shapes):
        for instance in range(instances):
            position, rotation = rng.uniform(-4, 4, 3), random_rotations(rng, 1)[0]
            plan.add_mesh(shape if instance == 0 else k, position, rotation)
            corners.append(shape.corners.astype(np.float64) @ rotation.T + position)
            owner.append(np.full(len(shape.faces), len(plan.kind) - 1))
            face.append(np.arange(len(shape.faces)))
    origins, directions = random_rays(seed, 1500)
    directions[1::2] = unit(rng.uniform(-4, 4, (750, 3)) - origins[1::2])
    got = cast_through(plan.world(), origins, directions)

    t, least, cosine = all_triangles(origins, directions, np.concatenate(corners))
    sure = np.where((t >= 0) & (least >= 1e-5), t, INF)
    possible = np.where((t >= 0) & (least >= -1e-5), t, INF)
    room = 1e-5 * (1 + np.abs(t)) / np.maximum(cosine, 1e-3)
    farthest, nearest = (sure + room).min(axis=1), (possible - room).min(axis=1)
    wrong = ~((nearest <= got.distance) & (got.distance <= farthest))
    assert not wrong.any(), f"seed {seed}: ray {np.flatnonzero(wrong)[0]} of {wrong.sum()}"
    is_plain = farthest < np.minimum(nearest, 1e6) + 1e-3
    best = sure.argmin(axis=1)
    np.testing.assert_array_equal(got.shape[is_plain], np.concatenate(owner)[best][is_plain], f"seed {seed}")
    np.testing.assert_array_equal(got.face[is_plain], np.concatenate(face)[best][is_plain], f"seed {seed}")
    assert is_plain.sum() > 300


@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT])
@pytest.mark.parametrize("seed", range(3))
def test_hit_is_the_nearest_of_all_shapes_cast_one_by_one(seed: int, cull: int) -> None:
    """Bit for bit, so the trees have no effect; a test of `visible`, too."""
    plan = random_plan(seed, count=25)
    world = plan.world()
    rays = random_rays(seed, 3000)
    got = cast_through(world, *rays, cull=cull)
    numbers = np.arange(len(world.geometry.kind))
    each = [cast_through(world, *rays, cull=cull, visible=numbers == k) for k in numbers]
    for k, hits in enumerate(each):
        assert set(np.unique(hits.shape)) <= {-1, k}
    best = np.argmin([hits.distance for hits in each], axis=0)  # the lowest of equally near ones
    expected = [np.stack([hits[j] for hits in each])[best, np.arange(len(best))] for j in range(4)]
    assert_same(got, Hits._make(expected), f"seed {seed}")
    assert len(np.unique(got.shape)) > 15


def test_invisible_shapes_are_not_hit() -> None:
    plan = Plan()
    for x in (1, 3, 5):
        plan.add(SPHERE, (0.1, 0, 0), (x, 0, 0))
    for visible, expected in (((1, 1, 1), 0.9), ((0, 1, 1), 2.9), ((0, 0, 1), 4.9), ((0, 0, 0), INF)):
        got = cast_through(plan.world(), (0, 0, 0), (1, 0, 0), visible=np.array(visible, bool))
        assert got.distance[0] == pytest.approx(expected, rel=1e-6)


# ---- ties, limits, culling


def test_of_two_as_near_the_lower_shape_is_hit() -> None:
    rng = np.random.default_rng(0)
    plan = Plan()
    order = [int(i) for i in rng.permutation(np.repeat(np.arange(6), 3))]  # three equal shapes at each place
    for i in order:
        if i < 2:
            plan.add_mesh(cube() if not plan.trees else 0, (3.0 * i, 0, 0))
        elif i < 4:
            plan.add(BOX, (1, 1, 1), (3.0 * i, 0, 0))
        else:
            plan.add((SPHERE, PLANE)[i - 4], (1, 1, 1), (3.0 * i, 0, 0 if i == 4 else 1))
    x = 3.0 * np.arange(6)
    for dx, dy in rng.uniform(-0.5, 0.5, (50, 2)):
        got = cast_through(plan.world(), np.stack([x + dx, 0 * x + dy, 0 * x + 5], axis=-1), (0, 0, -1))
        np.testing.assert_array_equal(got.shape, [order.index(i) for i in range(6)])


def test_of_a_mesh_and_a_box_as_near_the_lower_shape_is_hit() -> None:
    for is_mesh_first in (True, False):
        plan = Plan()
        for is_mesh in (is_mesh_first, not is_mesh_first):
            if is_mesh:
                plan.add_mesh(cube())
            else:
                plan.add(BOX, (1, 1, 1))
        got = cast_through(plan.world(), (0.25, 0.125, 5), (0, 0, -1))
        assert (got.distance[0], got.shape[0], got.face[0] >= 0) == (4, 0, is_mesh_first)


SOLIDS = [
    (PLANE, (0, 0, 0), 5.0),
    (SPHERE, (1, 0, 0), 4.0),
    (CAPSULE, (0.5, 0.5, 0), 4.0),
    (ELLIPSOID, (2, 3, 1), 4.0),
    (CYLINDER, (0.5, 1, 0), 4.0),
    (BOX, (1, 2, 1), 4.0),
    ("mesh", (0, 0, 0), 4.0),
]


def one_solid(kind: int | str, size: tuple[float, float, float]) -> Plan:
    plan = Plan()
    if isinstance(kind, str):
        plan.add_mesh(cube())
    else:
        plan.add(kind, size)
    return plan


@pytest.mark.parametrize(("kind", "size", "distance"), SOLIDS)
def test_limit_is_inclusive(kind: int | str, size: tuple[float, float, float], distance: float) -> None:
    world = one_solid(kind, size).world()
    below, above = (float(np.nextafter(np.float32(distance), np.float32(end))) for end in (0, 100))
    for limit, expected in ((INF, distance), (above, distance), (distance, distance), (below, INF), (0, INF)):
        got = cast_through(world, (0, 0, 5), (0, 0, -1), limit)
        assert got.distance[0] == expected, f"limit {limit!r}: got {got.distance[0]!r}, expected {expected!r}"
        assert got.shape[0] == (0 if expected < INF else -1)


@pytest.mark.parametrize(("kind", "size", "distance"), SOLIDS)
def test_origin_on_the_surface_is_at_0_even_with_a_limit_of_0(
    kind: int | str, size: tuple[float, float, float], distance: float
) -> None:
    world = one_solid(kind, size).world()
    got = cast_through(world, (0, 0, 5 - distance), (0, 0, -1), limit=0)
    assert (got.distance[0], got.shape[0]) == (0, 0)


@pytest.mark.parametrize(("kind", "size", "distance"), SOLIDS[1:])
def test_normal_is_outward_and_culling_goes_by_it(
    kind: int | str, size: tuple[float, float, float], distance: float
) -> None:
    world = one_solid(kind, size).world()
    top = 5 - distance
    down, up = (0, 0, -1), (0, 0, 1)
    for origin, direction, cull, expected, normal in (
        ((0, 0, 5), down, CULL_NONE, distance, up),
        ((0, 0, 5), down, CULL_BACK, distance, up),
        ((0, 0, 5), down, CULL_FRONT, 5 + top, down),
        ((0, 0, 0), up, CULL_NONE, top, up),
        ((0, 0, 0), up, CULL_FRONT, top, up),
        ((0, 0, 0), up, CULL_BACK, INF, (0, 0, 0)),
    ):
        got = cast_through(world, origin, direction, cull=cull)
        assert got.distance[0] == pytest.approx(expected, rel=1e-6), f"{origin}, {direction}, cull {cull}"
        np.testing.assert_allclose(got.normal[0], normal, atol=1e-6)


def test_normals_turn_with_the_shape() -> None:
    plan = random_plan(4)
    rays = random_rays(4, 3000)
    limit = 100.0  # a ray along the plane may meet it at 1e16 m when both are turned
    got = cast_through(plan.world(), *rays, limit)
    rotation = random_rotations(np.random.default_rng(0), 1)[0]
    plan.position = [rotation @ p for p in plan.position]
    plan.rotation = [rotation @ r for r in plan.rotation]
    turned_hits = cast_through(plan.world(), rays[0] @ rotation.T, rays[1] @ rotation.T, limit)
    same = (got.shape == turned_hits.shape) & (got.face == turned_hits.face)
    assert same.mean() > 0.998
    cosine = np.abs(dot(rays[1], got.normal.astype(np.float64)))
    judged = same & (got.shape >= 0) & (cosine > 0.2)
    np.testing.assert_allclose(turned_hits.normal[judged], got.normal[judged] @ rotation.T, atol=1e-3)
    np.testing.assert_allclose(norm(got.normal[judged].astype(np.float64)), 1, atol=1e-6)


# ---- rays that are not finite


@pytest.mark.parametrize("bad", [np.nan, INF, -INF])
def test_ray_that_is_not_finite_has_distance_nan_and_hits_nothing(bad: float) -> None:
    world = random_plan(0).world()
    origins, directions = random_rays(0, 600)
    expected = cast_through(world, origins, directions)
    broken = np.zeros(600, bool)
    for k in range(6):
        where = (origins, directions)[k // 3]
        where[k::12, k % 3] = bad
        broken[k::12] = True
    got = cast_through(world, origins, directions)
    assert np.isnan(got.distance[broken]).all()
    assert (got.shape[broken] == -1).all()
    assert (got.face[broken] == -1).all()
    assert (got.normal[broken] == 0).all()
    assert_same(Hits._make(a[~broken] for a in got), Hits._make(a[~broken] for a in expected))


@pytest.mark.parametrize("size", [1e10, 0.9 * FARTHEST, 1.1 * FARTHEST, 1e30, 1e38, 1e39, 1e300])
def test_origin_beyond_all_measure_does_not_crash(size: float) -> None:
    """Where float32 overflows, comparisons with boxes are with NaN; empty boxes must not be entered."""
    world = random_plan(0).world()
    directions = unit(np.random.default_rng(0).normal(size=(300, 3)))
    directions[:6] = [*np.eye(3), *-np.eye(3)]
    got = cast_through(world, -size * directions, directions)
    is_beyond = np.abs(size * directions).max(axis=1) > FARTHEST
    np.testing.assert_array_equal(np.isnan(got.distance), is_beyond)
    hit = got.shape >= 0
    assert hit.any() != is_beyond.all()
    np.testing.assert_allclose(got.distance[hit], size, rtol=1e-3)
    assert (got.distance[~hit & ~is_beyond] == INF).all()


@pytest.mark.parametrize("dtype", [wp.vec3, wp.vec3d])
def test_unit_directions(dtype: type) -> None:
    vectors = np.array([(3, 0, 4), (0, -1e-3, 0), (1e3, 1e3, 1e3), (0, 0, 0), (np.nan, 0, 1)])
    unit_vectors = unit_directions(wp.array(vectors, dtype=dtype, device="cpu")).numpy()
    s = 1 / np.sqrt(3)
    np.testing.assert_allclose(unit_vectors[:3], [(0.6, 0, 0.8), (0, -1, 0), (s, s, s)], rtol=1e-15)
    assert np.isnan(unit_vectors[3]).all()
    assert np.isnan(unit_vectors[4]).any()


# ---- slices and threads


@pytest.mark.parametrize("count", [1, slices.RAYS_PER_SLICE, slices.RAYS_PER_SLICE + 1, 5 * slices.RAYS_PER_SLICE - 7])
def test_threads_do_not_show(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    world = random_plan(1).world()
    rays = random_rays(1, count)
    hits = []
    for threads in ("1", "2", "7"):
        monkeypatch.setenv("RIGCAST_THREADS", threads)
        hits.append(cast_through(world, *rays))
    for got in hits[1:]:
        assert_same(got, hits[0])


def test_no_rays() -> None:
    assert len(cast_through(random_plan(1).world(), np.zeros((0, 3)), np.zeros((0, 3))).distance) == 0
