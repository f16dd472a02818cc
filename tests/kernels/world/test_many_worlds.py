"""Many worlds in one geometry: each has the hits of that world alone, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_worlds import Doubles, Hits, Plan, assert_same, random_plan, unit
from numpy.typing import ArrayLike
from scattered_worlds import BEAMS, WORLDS, scattered, sensor, sensor_poses

from rigcast.kernels.cast import cast
from rigcast.kernels.launching import slices
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes import solids
from rigcast.kernels.shapes.triangle import CULL_NONE
from rigcast.kernels.world.arrays import Shapes
from rigcast.kernels.world.world import World

CAST = pytest.mark.parametrize("packets", [False, True], ids=["alone", "in packets"])


def cast_all(world: World, rays: Rays, visible: ArrayLike = True) -> list[Hits]:
    """The hits in each world."""
    seen = np.full(world.geometry.kind.size, True) if visible is True else np.ravel(visible)
    hits = cast(world.geometry, wp.array(seen, dtype=wp.bool, device="cpu"), rays, np.inf, CULL_NONE)
    split = [np.split(a.numpy(), rays.worlds) for a in (hits.distance, hits.shape, hits.face, hits.normal)]
    return [Hits(*each) for each in zip(*split, strict=True)]


def cast_one(
    plan: Plan, poses: tuple[Doubles, Doubles], at: tuple[Doubles, Doubles], packets: bool, **how: ArrayLike
) -> Hits:
    """The hits in a world by itself."""
    world = World(plan.trees, plan.shapes, "cpu")
    world.update(*poses)
    return cast_all(world, sensor(at[0][None], at[1][None], packets), **how)[0]


@CAST
@pytest.mark.parametrize("seed", range(3))
def test_each_world_is_hit_as_if_it_were_alone(seed: int, packets: bool) -> None:
    plan = random_plan(seed)
    position, rotation = scattered(plan, seed)
    at = sensor_poses(seed)
    world = plan.world()
    for _ in range(2):
        world.update(position, rotation)
        for w, got in enumerate(cast_all(world, sensor(*at, packets))):
            alone = cast_one(plan, (position[w], rotation[w]), (at[0][w], at[1][w]), packets)
            assert_same(got, alone, f"seed {seed}, world {w}")
            assert (got.shape >= 0).mean() > 0.1
        position = position[::-1]


@CAST
def test_poses_in_float32_and_on_the_device_are_used_as_they_are(packets: bool) -> None:
    plan = random_plan(1)
    position, rotation = (a.astype(np.float32) for a in scattered(plan, 1))
    at = sensor_poses(1)
    in_double, in_float, in_place = (World(plan.trees, plan.shapes, "cpu") for _ in range(3))
    in_double.update(position.astype(np.float64), rotation.astype(np.float64))
    in_float.update(position, rotation)
    positions = wp.array(position, dtype=wp.vec3, device="cpu")
    rotations = wp.array(rotation.reshape(WORLDS, -1, 3, 3), dtype=wp.mat33, device="cpu")
    in_place.update(positions, rotations)
    assert in_place.geometry.position_float.ptr == positions.ptr
    expected = cast_all(in_double, sensor(*at, packets))
    for other in (in_float, in_place):
        for got, alone in zip(cast_all(other, sensor(*at, packets)), expected, strict=True):
            assert_same(got, alone)
    positions.numpy()[...] += 0.25
    in_place.update(positions, rotations)
    in_double.update((position + np.float32(0.25)).astype(np.float64), rotation.astype(np.float64))
    expected = cast_all(in_double, sensor(*at, packets))
    for got, alone in zip(cast_all(in_place, sensor(*at, packets)), expected, strict=True):
        assert_same(got, alone, "moved in place")


@CAST
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e30])
def test_a_world_that_is_lost_does_not_disturb_the_others(bad: float, packets: bool) -> None:
    """Shapes or the sensor of a world have poses that are not finite, in the first world or another."""
    plan = random_plan(2)
    at = sensor_poses(2)
    for lost in (0, 3):
        position, rotation = scattered(plan, 2)
        position[lost] = bad
        rotation[lost + 1, ::2] = np.nan
        sensors = at[0].copy(), at[1]
        sensors[0][lost + 2] = bad
        world = World(plan.trees, plan.shapes, "cpu")
        world.update(position, rotation)
        found = cast_all(world, sensor(*sensors, packets))
        for w, got in enumerate(found):
            alone = cast_one(plan, (position[w], rotation[w]), (sensors[0][w], sensors[1][w]), packets)
            assert_same(got, alone, f"lost {lost}, world {w}")
        assert (found[lost].distance == np.inf).all()
        assert np.isnan(found[lost + 2].distance).all()
        assert 0 < np.isfinite(found[lost + 1].distance).mean() < 0.5


@CAST
def test_worlds_may_differ_in_what_is_visible(packets: bool) -> None:
    plan = random_plan(3)
    position, rotation = scattered(plan, 3)
    at = sensor_poses(3)
    visible = np.random.default_rng(3).random((WORLDS, len(plan.kind))) < 0.6
    world = World(plan.trees, plan.shapes, "cpu")
    world.update(position, rotation)
    for w, got in enumerate(cast_all(world, sensor(*at, packets), visible)):
        alone = cast_one(plan, (position[w], rotation[w]), (at[0][w], at[1][w]), packets, visible=visible[w])
        assert_same(got, alone, f"world {w}")


@CAST
def test_worlds_may_differ_in_sizes_and_meshes(packets: bool) -> None:
    plan = random_plan(4)
    position, rotation = scattered(plan, 4)
    at = sensor_poses(4)
    plans = [random_plan(4) for _ in range(WORLDS)]
    for w, each in enumerate(plans):
        scale = 0.5 + 0.2 * w
        each.size = [size * scale for size in each.size]
        each.half = [half if tree >= 0 else half * scale for half, tree in zip(each.half, each.tree, strict=True)]
        if w % 2:
            swap = {0: 1, 1: 2, 2: 0, -1: -1}
            each.tree = [swap[tree] for tree in each.tree]
            for k, tree in enumerate(each.tree):
                if tree >= 0:
                    each.center[k], half = each._box(tree)
                    each.half[k] = half * (1 + 1e-6)
    world = World(plan.trees, plan.shapes, "cpu")
    world.set_shapes(Shapes.joined([each.shapes for each in plans], np.zeros(WORLDS, int)))
    world.update(position, rotation)
    for w, got in enumerate(cast_all(world, sensor(*at, packets))):
        alone = cast_one(plans[w], (position[w], rotation[w]), (at[0][w], at[1][w]), packets)
        assert_same(got, alone, f"world {w}")
    for part in (slice(2, 5), slice(4, 7), slice(6, 7)):
        world.update(position[part], rotation[part], part)
        for w, got in enumerate(cast_all(world, sensor(at[0][part], at[1][part], packets)), start=part.start):
            alone = cast_one(plans[w], (position[w], rotation[w]), (at[0][w], at[1][w]), packets)
            assert_same(got, alone, f"world {w}, in worlds {part.start} to {part.stop - 1}")
    with pytest.raises(ValueError, match="poses of 2 worlds, expected 7"):
        world.update(position[:2], rotation[:2])


def test_the_number_of_worlds_may_change() -> None:
    plan = random_plan(5)
    at = sensor_poses(5)
    world = plan.world()
    for worlds in (3, 1, 7, 3):
        position, rotation = scattered(plan, worlds, worlds)
        world.update(position, rotation)
        for w, got in enumerate(cast_all(world, sensor(at[0][:worlds], at[1][:worlds], True))):
            assert_same(
                got, cast_one(plan, (position[w], rotation[w]), (at[0][w], at[1][w]), True), f"world {w} of {worlds}"
            )


def test_worlds_without_shapes_are_empty() -> None:
    world = Plan().world()
    world.update(np.zeros((WORLDS, 0, 3)), np.zeros((WORLDS, 0, 9)))
    for got in cast_all(world, sensor(*sensor_poses(0), True)):
        assert (got.distance == np.inf).all()


@pytest.mark.parametrize("count", [3, 8, 9, 10, 16, 17, 25, 60, 200])
def test_trees_of_many_worlds_take_at_most_100_bytes_a_shape(count: int) -> None:
    """With planes, which are unbounded, and shapes of all sizes, some crowded, some far apart."""
    for planes in (0, 1, 4):
        rng, plan = np.random.default_rng(count + planes), Plan()
        for k in range(count + planes):
            kind = solids.PLANE if k >= count else solids.ELLIPSOID
            size = np.zeros(3) if k >= count else np.exp(rng.normal(size=3)) * 0.3
            plan.add(kind, size, rng.normal(size=3) * rng.choice([0.1, 1, 10]))
        world = plan.world()
        promised = world.bytes_per_world
        position, rotation = scattered(plan, count)
        world.update(position, rotation)
        g, at = world.geometry, sensor_poses(count)
        taken = sum(array.capacity for array in (g.top, g.anchor, g.top_reach, world._top._fits, world._top._area))
        where = f"{count} shapes, {planes} planes"
        assert taken <= WORLDS * 100 * (count + planes), f"{where}: {taken / WORLDS / (count + planes):.0f} bytes"
        assert taken <= WORLDS * world.bytes_per_world <= WORLDS * promised, where
        for w, got in enumerate(cast_all(world, sensor(*at, True))[:2]):
            assert_same(got, cast_one(plan, (position[w], rotation[w]), (at[0][w], at[1][w]), True), where)


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_do_not_show(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = random_plan(6, count=120)
    position, rotation = scattered(plan, 6, 100)
    at = sensor_poses(6, 100)
    monkeypatch.setattr(slices, "thread_count", lambda: threads)
    world = World(plan.trees, plan.shapes, "cpu")
    world.update(position, rotation)
    found = cast_all(world, sensor(*at, True))
    for w in (0, 49, 99):
        alone = cast_one(plan, (position[w], rotation[w]), (at[0][w], at[1][w]), True)
        assert_same(found[w], alone, f"world {w}")


def test_rays_may_differ_from_world_to_world() -> None:
    plan = random_plan(7)
    position, rotation = scattered(plan, 7)
    at = sensor_poses(7)
    rng = np.random.default_rng(7)
    directions, origins = unit(rng.normal(size=(WORLDS, BEAMS, 3))), rng.normal(size=(WORLDS, BEAMS, 3))
    own = {
        "directions": wp.array(directions, dtype=wp.vec3d, device="cpu"),
        "origins": wp.array(origins, dtype=wp.vec3d, device="cpu"),
    }
    world = World(plan.trees, plan.shapes, "cpu")
    world.update(position, rotation)
    for w, got in enumerate(cast_all(world, replace(sensor(*at, False), **own))):
        world.update(position[w], rotation[w])
        rays = replace(
            sensor(at[0][w : w + 1], at[1][w : w + 1], False),
            directions=wp.array(directions[w], dtype=wp.vec3d, device="cpu"),
            origins=wp.array(origins[w], dtype=wp.vec3d, device="cpu"),
        )
        assert_same(got, cast_all(world, rays)[0], f"world {w}")
        world.update(position, rotation)
