"""Casts on a GPU have the hits of casts on the CPU."""

import numpy as np
import pytest
from made_worlds import Plan, cast_through, cube, icosphere, random_plan, random_rays, random_rotations, unit

from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.kernels.world.world import World

pytestmark = pytest.mark.cuda
DEVICES = ("cpu", "cuda:0")


@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT])
def test_cuda_hits_what_the_cpu_hits(cull: int) -> None:
    """Roots, divisions and fused products may round differently: a few ulps, and another face for 1 ray in 10^4."""
    cpu, cuda = (cast_through(random_plan(0).world(device), *random_rays(0, 50_000), cull=cull) for device in DEVICES)
    same = (cpu.shape == cuda.shape) & (cpu.face == cuda.face)
    assert same.mean() > 1 - 1e-4
    hit = same & (cpu.shape >= 0)
    np.testing.assert_allclose(cuda.distance[hit], cpu.distance[hit], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(cuda.normal[hit], cpu.normal[hit], atol=1e-2)
    assert (np.abs(cuda.distance[hit] - cpu.distance[hit]) <= 1e-6 * (1 + cpu.distance[hit])).mean() > 0.99


def test_moved_shapes_are_hit_where_they_are() -> None:
    plan = random_plan(1)
    rng = np.random.default_rng(1)
    worlds = [World(plan.trees, plan.shapes, device) for device in DEVICES]
    position, _ = plan.poses()
    for _ in range(3):
        position = position + rng.normal(size=position.shape)
        rotation = random_rotations(rng, len(position)).reshape(-1, 9)
        for world in worlds:
            world.update(position, rotation)
        cpu, cuda = (cast_through(world, *random_rays(1, 5000)) for world in worlds)
        assert (cpu.shape == cuda.shape).mean() > 0.999


@pytest.mark.parametrize("subdivisions", [None, 3])
def test_no_ray_leaves_a_closed_mesh(subdivisions: int | None) -> None:
    shape = icosphere(subdivisions) if subdivisions else cube()
    rng = np.random.default_rng(2)
    corners = shape.corners[rng.integers(0, len(shape.faces), 100_000)].astype(np.float64)
    along = rng.choice([0, 0.5, rng.random()], (100_000, 1))
    targets = corners[:, 0] + along * (corners[:, 1] - corners[:, 0])
    origins = rng.uniform(-0.5, 0.5, targets.shape)
    plan = Plan()
    plan.add_mesh(shape)
    got = cast_through(plan.world("cuda:0"), origins, unit(targets - origins))
    assert np.isfinite(got.distance).all()


def test_rays_that_are_not_finite_and_an_empty_world() -> None:
    origins, directions = random_rays(3, 300)
    origins[::3, 0], directions[1::3, 1] = np.nan, np.inf
    got = cast_through(random_plan(3).world("cuda:0"), origins, directions)
    is_bad = np.arange(300) % 3 < 2
    np.testing.assert_array_equal(np.isnan(got.distance), is_bad)
    assert (got.shape[is_bad] == -1).all()
    nothing = cast_through(Plan().world("cuda:0"), *random_rays(3, 300))
    assert (nothing.distance == np.inf).all()
