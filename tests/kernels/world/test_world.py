"""Shapes that move: a refitted tree gives the hits of a new one, and shapes whose pose is not finite are not hit."""

import numpy as np
import pytest
from made_worlds import (
    KINDS,
    Doubles,
    Hits,
    Plan,
    assert_same,
    cast_through,
    cube,
    icosphere,
    random_plan,
    random_rays,
    random_rotations,
    unit,
)

from rigcast.kernels.shapes.solids import BOX, PLANE, SPHERE
from rigcast.kernels.world.world import World

RAYS = 4000


def cast_anew(plan: Plan, position: Doubles, rotation: Doubles, **how: object) -> Hits:
    world = World(plan.trees, plan.shapes, "cpu")
    world.update(position, rotation)
    return cast_through(world, *random_rays(1, RAYS), **how)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("step", [0.01, 0.5, 100.0], ids=["creeping", "walking", "jumping"])
def test_moved_shapes_are_hit_as_in_a_new_world(seed: int, step: float) -> None:
    plan = random_plan(seed)
    rng = np.random.default_rng(seed)
    world = plan.world()
    position, rotation = plan.poses()
    for k in range(5):
        position = position + step * rng.normal(size=position.shape)
        rotation = random_rotations(rng, len(position)).reshape(-1, 9)
        world.update(position, rotation)
        expected = cast_anew(plan, position, rotation)
        assert_same(cast_through(world, *random_rays(1, RAYS)), expected, f"seed {seed}, step {k}")
        assert (expected.shape >= 0).mean() > 0.1 or step > 10


def test_the_tree_is_refitted_for_small_moves_and_rebuilt_when_it_has_grown_too_loose() -> None:
    plan = random_plan(0)
    world = plan.world()
    position, rotation = plan.poses()
    children = world.geometry.top.numpy()["child"]
    world.update(position + 0.001 * np.random.default_rng(0).normal(size=position.shape), rotation)
    np.testing.assert_array_equal(world.geometry.top.numpy()["child"], children)
    world.update(np.random.default_rng(0).permutation(position), rotation)
    after = world.geometry.top.numpy()["child"]
    assert after.shape != children.shape or (after != children).any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("part", ["position", "rotation"])
def test_pose_that_is_not_finite_is_not_hit_until_it_is_again(part: str, bad: float) -> None:
    plan = random_plan(3)
    world = plan.world()
    position, rotation = plan.poses()
    before = cast_through(world, *random_rays(1, RAYS))
    lost = np.unique(before.shape[before.shape >= 0])[::3]
    assert 0 in lost or len(lost) > 3
    broken = {"position": position.copy(), "rotation": rotation.copy()}
    broken[part][lost, lost % broken[part].shape[1]] = bad
    visible = ~np.isin(np.arange(len(position)), lost)
    for _ in range(2):
        world.update(broken["position"], broken["rotation"])
        got = cast_through(world, *random_rays(1, RAYS))
        assert_same(got, cast_through(plan.world(), *random_rays(1, RAYS), visible=visible), f"without {lost}")
    world.update(position, rotation)
    assert_same(cast_through(world, *random_rays(1, RAYS)), before, "back again")


def test_lost_shape_comes_back_wherever_it_is() -> None:
    plan = random_plan(3)
    position, rotation = plan.poses()
    start = position.copy()
    start[::2] = np.nan
    world = World(plan.trees, plan.shapes, "cpu")
    world.update(start, rotation)
    world.update(position, rotation)
    assert_same(cast_through(world, *random_rays(1, RAYS)), cast_anew(plan, position, rotation))


def test_all_poses_lost_is_an_empty_world() -> None:
    plan = random_plan(3)
    world = plan.world()
    position, rotation = plan.poses()
    world.update(position * np.nan, rotation)
    got = cast_through(world, *random_rays(1, RAYS))
    assert (got.distance == np.inf).all()
    assert (got.shape == -1).all()
    assert (got.normal == 0).all()


def test_no_shapes_no_hits() -> None:
    world = Plan().world()
    got = cast_through(world, *random_rays(1, 100))
    assert (got.distance == np.inf).all()
    assert (got.shape == -1).all()
    assert (got.face == -1).all()


@pytest.mark.parametrize("kind", ["sphere", "mesh", "plane", "mesh without area"])
def test_one_shape(kind: str) -> None:
    plan = Plan()
    if kind == "sphere":
        plan.add(SPHERE, (1, 0, 0), (0, 0, -3))
    elif kind == "plane":
        plan.add(PLANE, (0, 0, 0), (0, 0, -2))
    else:
        plan.add_mesh(cube()._replace(vertices=cube().vertices * (kind == "mesh")), (0, 0, -3))
    got = cast_through(plan.world(), (0.1, 0.2, 0), [(0, 0, -1), (0, 0, 1)])
    if kind == "mesh without area":
        np.testing.assert_array_equal(got.shape, [-1, -1])
        return
    expected = 3 - np.sqrt(1 - 0.05) if kind == "sphere" else 2
    np.testing.assert_allclose(got.distance, [expected, np.inf], rtol=1e-6)
    np.testing.assert_array_equal(got.shape, [0, -1])
    np.testing.assert_array_equal(got.face >= 0, [kind == "mesh", False])


def test_meshes_without_area_beside_others_are_not_hit() -> None:
    plan = Plan()
    flat = cube()._replace(vertices=np.zeros((8, 3), np.float32))
    for shape in (flat, cube(), flat, icosphere(1), flat):
        plan.add_mesh(shape, (3.0 * len(plan.kind), 0, 0))
    x = 3.0 * np.arange(5)
    got = cast_through(plan.world(), np.stack([x, 0 * x, 0 * x + 5], axis=-1), (0, 0, -1))
    np.testing.assert_array_equal(got.shape, [-1, 1, -1, 3, -1])


@pytest.mark.parametrize("distance", [1.0, 1e3, 1e5, 1e7])
def test_unbounded_plane_is_hit_however_far(distance: float) -> None:
    plan = Plan()
    plan.add(SPHERE, (1, 0, 0), (50, 0, 0))
    plan.add(PLANE, (0, 0, 0))
    plan.add(PLANE, (0, 3, 0), (0, 0, -1))
    slanted = np.array([1.0, 0, -1]) / np.sqrt(2)
    got = cast_through(plan.world(), (0, -1, distance), [(0, 0, -1), slanted, (0, 0, 1), (1, 0, 0)])
    np.testing.assert_allclose(got.distance, [distance, distance * np.sqrt(2), np.inf, np.inf], rtol=1e-6)
    np.testing.assert_array_equal(got.shape, [1, 1, -1, -1])


def test_of_many_unbounded_planes_the_nearest_is_hit() -> None:
    rng = np.random.default_rng(0)
    plan = Plan()
    for k in range(30):
        size = (0, 0, 0) if k % 3 else (0, 0.5, 0)  # an unbounded plane, or a strip
        plan.add(PLANE, size, rng.uniform(-4, 4, 3), random_rotations(rng, 1)[0])
        plan.add(SPHERE, (0.3, 0, 0), rng.uniform(-4, 4, 3))
    world = plan.world()
    position, rotation = plan.poses()
    position[[0, 4]] = np.nan
    world.update(position, rotation)
    got = cast_through(world, *random_rays(2, RAYS))
    each = [cast_through(world, *random_rays(2, RAYS), visible=np.arange(60) == k) for k in range(60)]
    np.testing.assert_array_equal(got.distance, np.min([hits.distance for hits in each], axis=0))
    expected = np.argmin([hits.distance for hits in each], axis=0)
    np.testing.assert_array_equal(got.shape, np.where(got.distance < np.inf, expected, -1))
    assert len(set(got.shape[got.shape >= 0]) - {0, 4}) == len(set(got.shape[got.shape >= 0])) > 40


def facing(axis: int, sign: float) -> Doubles:
    """The rotation (3, 3) of a plane along two axes of the world, with its normal along the third."""
    normal, along = sign * np.eye(3)[axis], np.eye(3)[axis - 1]
    return np.stack([along, np.cross(normal, along), normal], axis=1)


@pytest.mark.parametrize("distance", [0.0, 30.0, 1e6])
def test_unbounded_planes_along_the_axes_are_hit_from_their_front(distance: float) -> None:
    """Rays from among them and from a distance, some of them along, on or away from planes."""
    plan, rng = Plan(), np.random.default_rng(0)
    for k in range(12):
        plan.add(PLANE, (0, 0, 0), rng.integers(-4, 5, 3), facing(k % 3, (-1) ** k))
        plan.add(SPHERE, (0.01, 0, 0), rng.uniform(-4, 4, 3))
    origins = rng.integers(-4, 5, (RAYS, 3)) + distance * rng.normal(size=(RAYS, 3))
    directions = rng.normal(size=(RAYS, 3)) * (rng.random((RAYS, 3)) < 0.7)
    directions = unit(np.where(directions.any(axis=1, keepdims=True), directions, (0.0, 0.0, 1.0)))
    got = cast_through(plan.world(), origins, directions, visible=np.array(plan.kind) == PLANE)
    normals = np.array([facing(k % 3, (-1) ** k)[:, 2] for k in range(12)])
    height = np.einsum("rpk,pk->rp", origins[:, None] - np.array(plan.position)[::2], normals)
    with np.errstate(divide="ignore", invalid="ignore"):
        each = np.where((height >= 0) & (directions @ normals.T < 0), height / -(directions @ normals.T), np.inf)
    expected = each.min(axis=1)
    np.testing.assert_allclose(got.distance, expected, rtol=1e-6, atol=1e-9)
    assert 0.2 < np.isfinite(expected).mean() < 1


def test_only_planes_along_the_axes_have_thin_boxes() -> None:
    plan = Plan()
    for axis in range(3):
        plan.add(PLANE, (0, 0, 0), (axis, 2, 3), facing(axis, 1))
    plan.add(PLANE, (0, 0, 0), (1, 2, 3), random_rotations(np.random.default_rng(0), 1)[0])
    root = plan.world().geometry.top.numpy()[0]
    half = np.stack([root["half_x"], root["half_y"], root["half_z"]], axis=1)[np.argsort(~root["child"][:4])]
    np.testing.assert_array_equal(np.isfinite(half), [*np.eye(3, dtype=bool), [False] * 3])
    assert half[np.isfinite(half)].max() < 1e-5


@pytest.mark.parametrize("offset", [1e5, 1e7])
def test_world_far_from_its_origin_is_hit_the_same(offset: float) -> None:
    """Poses and origins are multiples of 2^-20 m, and so are exact in float64 at the offset, too."""
    plan = random_plan(5)
    position, rotation = plan.poses()
    position = np.round(position * 2.0**20) / 2.0**20
    origins, directions = random_rays(1, RAYS)
    origins = np.round(origins * 2.0**20) / 2.0**20
    far = offset * np.array([1.0, -1.0, 0.5])
    hits = []
    for shift in (0 * far, far):
        world = World(plan.trees, plan.shapes, "cpu")
        world.update(position + shift, rotation)
        hits.append(cast_through(world, origins + shift, directions))
    near, moved = hits
    assert_same(moved._replace(normal=near.normal), near)
    np.testing.assert_allclose(moved.normal, near.normal, atol=1e-6)
    assert (near.shape >= 0).mean() > 0.4


def test_world_that_travels_far_away_takes_its_anchor_along() -> None:
    plan = Plan()
    rng = np.random.default_rng(0)
    for _ in range(50):
        plan.add(BOX, (0.01, 0.01, 0.01), rng.uniform(-1, 1, 3))
    world = plan.world()
    position, rotation = plan.poses()
    far = np.array([1e6, 1e6, 0.0])
    world.update(position + far, rotation)
    np.testing.assert_allclose(world.geometry.anchor.numpy()[0], far, atol=1.0)
    top = world.geometry.top.numpy()
    leaves = (top["child"] < 0) & np.isfinite(top["half_x"])
    assert top["half_x"][leaves].max() < 0.0101, "boxes are loose"
    got = cast_through(world, position + far + [0, 0, 5], (0, 0, -1))
    assert (got.distance <= 5 - 0.0099).all()


def test_poses_are_copied() -> None:
    plan = random_plan(2)
    world = World(plan.trees, plan.shapes, "cpu")
    position, rotation = plan.poses()
    world.update(position, rotation)
    expected = cast_through(world, *random_rays(1, RAYS))
    position[...], rotation[...] = 0, 0
    assert_same(cast_through(world, *random_rays(1, RAYS)), expected)


@pytest.mark.parametrize("other", ["as many triangles", "more", "fewer", "none"])
def test_world_with_another_mesh_is_one_built_with_it(other: str) -> None:
    shape = {
        "as many triangles": icosphere(2)._replace(
            vertices=icosphere(2).vertices * np.array([0.5, 1, 0.7], np.float32)
        ),
        "more": icosphere(3),
        "fewer": cube(),
        "none": cube()._replace(faces=cube().faces[:0]),
    }[other]
    plan, planned = random_plan(6), random_plan(6)
    world = plan.world()
    planned.replace_mesh(0, shape)
    world.set_tree(0, planned.trees[0])
    world.set_shapes(planned.shapes)
    world.update(*plan.poses())
    expected = cast_through(planned.world(), *random_rays(1, RAYS))
    assert_same(cast_through(world, *random_rays(1, RAYS)), expected)
    assert np.isin(np.flatnonzero(np.array(plan.tree) == 0), expected.shape).any() or other == "none"


def test_world_with_other_sizes_is_one_built_with_them() -> None:
    """Also where a bounded plane becomes unbounded, and back."""
    small, large = Plan(), Plan()
    rng = np.random.default_rng(0)
    for k in range(30):
        where = rng.uniform(-4, 4, 3), random_rotations(rng, 1)[0]
        kind = KINDS[k % len(KINDS)]
        small.add(kind, rng.uniform(0.1, 0.5, 3), *where)
        large.add(kind, (0, 0, 0) if kind == PLANE else rng.uniform(0.5, 1.5, 3), *where)
    world = small.world()
    for plan in (large, small, large):
        world.set_shapes(plan.shapes)
        world.update(*plan.poses())
        assert_same(cast_through(world, *random_rays(1, RAYS)), cast_through(plan.world(), *random_rays(1, RAYS)))
