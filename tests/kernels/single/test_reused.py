"""Casts with a reused launch have the hits of casts with a new one, bit for bit."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp
from made_worlds import Hits, assert_same, random_plan, random_rays, rays_of

from rigcast.kernels.cast import cast
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_NONE
from rigcast.kernels.single.reused import ReusedCasts
from rigcast.kernels.world.world import World

COUNTS = (3000, 1, 0, 700, 3000, 40)


def all_of(world: World) -> wp.array:
    return wp.array(np.ones(len(world.geometry.kind), bool), dtype=wp.bool, device="cpu")


def as_numpy(hits: HitArrays) -> Hits:
    return Hits(*(array.numpy() for array in (hits.distance, hits.shape, hits.face, hits.normal)))


def rays(seed: int, count: int) -> Rays:
    return rays_of(*random_rays(seed, count))


def test_any_number_of_rays_in_turn() -> None:
    world = random_plan(1).world()
    casts, visible = ReusedCasts(world.geometry), all_of(world)
    kept = []
    for seed, count in enumerate(COUNTS):
        limit, cull = (np.inf, CULL_NONE) if seed % 2 else (5.0, CULL_BACK)
        kept.append((casts.cast(visible, rays(seed, count), limit, cull), limit, cull))
    for seed, (hits, limit, cull) in enumerate(kept):  # none is overwritten by a later cast
        expected = cast(world.geometry, visible, rays(seed, COUNTS[seed]), limit, cull)
        assert_same(as_numpy(hits), as_numpy(expected), f"seed {seed}")


def test_into_given_arrays() -> None:
    world = random_plan(2).world()
    out = HitArrays.empty(500, "cpu")
    assert ReusedCasts(world.geometry).cast(all_of(world), rays(0, 500), np.inf, CULL_NONE, out) is out
    assert_same(as_numpy(out), as_numpy(cast(world.geometry, all_of(world), rays(0, 500), np.inf, CULL_NONE)))


def test_shapes_are_where_they_stand_by_then() -> None:
    plan = random_plan(3)
    world, (position, rotation) = plan.world(), plan.poses()
    casts, visible = ReusedCasts(world.geometry), all_of(world)
    for step in range(3):
        world.update(position + step, rotation)
        expected = as_numpy(cast(world.geometry, visible, rays(step, 900), np.inf, CULL_NONE))
        assert_same(as_numpy(casts.cast(visible, rays(step, 900), np.inf, CULL_NONE)), expected, f"step {step}")


@pytest.mark.parametrize("threads", [2, 5])
def test_in_several_threads_at_once(threads: int) -> None:
    world = random_plan(4).world()
    casts, visible = ReusedCasts(world.geometry), all_of(world)

    def hits_of(seed: int) -> Hits:
        return as_numpy(casts.cast(visible, rays(seed, 2000), np.inf, CULL_NONE))

    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(hits_of, range(30)))
    for seed, hits in enumerate(found):
        expected = as_numpy(cast(world.geometry, visible, rays(seed, 2000), np.inf, CULL_NONE))
        assert_same(hits, expected, f"seed {seed}")
