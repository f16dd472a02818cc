"""Parallel rays in bundles have the hits of single rays, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_rays import DOWN, raster
from made_worlds import (
    Doubles,
    Hits,
    Plan,
    assert_same,
    grid,
    icosphere,
    random_plan,
    random_rotations,
    rays_of,
    turned,
    unit,
)
from numpy.typing import ArrayLike

from rigcast.kernels.cast import cast
from rigcast.kernels.launching import slices
from rigcast.kernels.packing.bundling import BUNDLE, sort_into_bundles
from rigcast.kernels.packing.firings import same_rows
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.kernels.world.world import World

ABOVE = np.array([0.0, 0.0, 3.0])


def scattered(count: int, spread: float) -> Doubles:
    return np.random.default_rng(0).uniform(-spread, spread, (count, 3))


ORIGINS: dict[str, Doubles] = {
    "height scan": raster(17, 11, 0.1),
    "dense": raster(60, 40, 0.02),
    "sparse": raster(15, 15, 1.0),
    "scattered": scattered(1000, 5.0),
    "far apart": scattered(100, 1e6),
    "behind each other": np.linspace(-3, 3, 100)[:, None] * DOWN,
    "all at one place": np.zeros((40, 3)),
    "one": np.zeros((1, 3)),
}


def in_bundles_and_alone(
    world: World,
    rays: Rays,
    limit: float = np.inf,
    cull: int = CULL_NONE,
    visible: ArrayLike = True,
) -> tuple[Hits, Hits]:
    """The same rays, cast in bundles and one by one."""
    seen = np.ascontiguousarray(np.broadcast_to(np.asarray(visible, bool), len(world.geometry.kind)))
    firing = np.zeros(rays.directions.size) if rays.firing is None else rays.firing.numpy()
    group = same_rows(np.column_stack([rays.directions.numpy(), firing]))
    both = []
    for each in (replace(rays, packets=sort_into_bundles(rays.origins.numpy(), group)), rays):
        hits = cast(world.geometry, wp.array(seen, dtype=wp.bool, device="cpu"), each, limit, cull)
        both.append(Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy()))
    return both[0], both[1]


def posed(rays: Rays, position: ArrayLike, rotation: ArrayLike) -> Rays:
    at = wp.array(np.reshape(position, (-1, 3)), dtype=wp.vec3d, device="cpu")
    return replace(
        rays, position=at, rotation=wp.array(np.reshape(rotation, (-1, 3, 3)), dtype=wp.mat33d, device="cpu")
    )


@pytest.mark.parametrize("name", ORIGINS)
def test_every_ray_is_in_one_place(name: str) -> None:
    origins = ORIGINS[name]
    group = np.random.default_rng(1).integers(0, 3, len(origins)).astype(np.int32)
    bundles = sort_into_bundles(origins, group).rays.numpy()
    assert bundles.shape[1] == BUNDLE
    assert sorted(bundles[bundles >= 0]) == list(range(len(origins)))
    for rays in bundles:
        count = (rays >= 0).sum()
        assert count > 0
        assert (rays[count:] == -1).all(), "rays first, then -1"
        assert len(set(group[rays[:count]])) == 1


def test_bundles_are_full_and_compact() -> None:
    """A bundle of 16 rays of a raster is at most 5 x 5 points large."""
    origins = raster(64, 64, 1.0)
    bundles = sort_into_bundles(origins, np.zeros(len(origins), np.int32)).rays.numpy()
    assert bundles.min() >= 0
    assert np.ptp(origins[bundles], axis=1).max() <= 4


@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ORIGINS)
def test_bundles_hit_what_single_rays_hit(name: str, seed: int, cull: int) -> None:
    rng = np.random.default_rng(seed)
    plan = random_plan(seed)
    direction = DOWN if seed == 0 else unit(rng.normal(size=3))
    rotation = np.eye(3) if seed == 0 else random_rotations(rng, 1)
    rays = posed(rays_of(ORIGINS[name], direction), ABOVE + rng.uniform(-1, 1, 3), rotation)
    visible = rng.random(len(plan.kind)) < 0.8
    limit = np.inf if seed < 2 else 4.0
    got, expected = in_bundles_and_alone(plan.world(), rays, limit, cull, visible)
    assert_same(got, expected, f"{name}, seed {seed}")
    if name in ("height scan", "dense", "scattered") and cull == CULL_NONE:
        assert np.isfinite(got.distance).any()


@pytest.mark.parametrize("far", [0.0, 1e3, 1.5e5])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("is_turned", [False, True])
def test_rays_at_vertices_and_edges_hit_what_they_hit_alone(scale: float, far: float, is_turned: bool) -> None:
    """Hits that float32 cannot decide: straight down at the vertices of a grid, and at the middles of its edges."""
    rotation = random_rotations(np.random.default_rng(0), 1)[0] if is_turned else np.eye(3)
    ground = grid(16, 0.05)
    plan = Plan()
    plan.add_mesh(ground._replace(vertices=scale * ground.vertices), (far, -far, far), rotation)
    plan.add_mesh(icosphere(2)._replace(vertices=0.3 * scale * icosphere(2).vertices), (far, -far, far), rotation)
    corners = ground.corners.astype(np.float64)
    targets = np.concatenate([ground.vertices, (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2])
    origins = scale * np.column_stack([targets[:, :2], np.ones(len(targets))])
    rays = posed(rays_of(origins, DOWN), (far, -far, far), rotation)
    got, expected = in_bundles_and_alone(plan.world(), rays)
    assert_same(got, expected, f"scale {scale}, {far} m away")
    is_inside = (np.abs(targets[:, :2]) < 0.99).all(axis=1)
    assert np.isfinite(got.distance[is_inside]).all(), "a ray leaks through the grid"


def test_rays_along_faces_hit_what_they_hit_alone() -> None:
    plan = Plan()
    plan.add_mesh(grid(8), rotation=np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    plan.add_mesh(turned(grid(8), 1))
    origins = np.concatenate([raster(9, 9, 0.25, 1.0), raster(17, 17, 1e-9, 1.0)])
    got, expected = in_bundles_and_alone(plan.world(), rays_of(origins, DOWN))
    assert_same(got, expected)


@pytest.mark.parametrize("threads", [1, 3])
def test_in_many_worlds_each_ray_hits_what_it_hits_alone(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some poses are not finite, and one is so far away that only some of its rays can be cast."""
    monkeypatch.setattr(slices, "thread_count", lambda: threads)
    rng, worlds = np.random.default_rng(2), 40
    plan = random_plan(2)
    position, rotation = plan.poses()
    world = plan.world()
    moved = position + rng.normal(scale=0.5, size=(worlds, *position.shape))
    world.update(moved, np.broadcast_to(rotation, (worlds, *rotation.shape)))
    at, turn = ABOVE + rng.uniform(-1, 1, (worlds, 3)), random_rotations(rng, worlds)
    at[5], turn[11, 1, 1], at[17] = np.nan, np.inf, (1e18, 0, 0)
    rays = replace(posed(rays_of(ORIGINS["height scan"], DOWN), at, turn), worlds=worlds)
    got, expected = in_bundles_and_alone(world, rays)
    assert_same(got, expected)
    lost = np.isnan(got.distance.reshape(worlds, -1))
    assert lost[5].all()
    assert lost[11].all()
    assert not lost[0].any()


def test_rays_of_several_directions_and_firings_hit_what_they_hit_alone() -> None:
    rng = np.random.default_rng(3)
    directions = unit(rng.normal(size=(4, 3)))[rng.integers(0, 4, 600)]
    firing = rng.integers(0, 3, 600).astype(np.int32)
    rays = posed(rays_of(scattered(600, 1.0), directions), rng.uniform(-2, 2, (3, 3)), random_rotations(rng, 3))
    rays = replace(rays, firing=wp.array(firing, dtype=int, device="cpu"))
    got, expected = in_bundles_and_alone(random_plan(3).world(), rays)
    assert_same(got, expected)
