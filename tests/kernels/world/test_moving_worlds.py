"""Shapes that move while rays are fired: each ray meets them at their poses at its own time."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_worlds import Hits, Plan, assert_same, cube, random_plan, random_rotations, unit
from moving_worlds import FIRINGS, Poses, fired, moving, rotation_about
from numpy.typing import NDArray
from trimesh import transformations

from rigcast.kernels.cast import cast
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.solids import BOX, CAPSULE, PLANE, SPHERE
from rigcast.kernels.shapes.triangle import CULL_NONE
from rigcast.kernels.world.world import World

CAST = pytest.mark.parametrize("packets", [False, True], ids=["alone", "in packets"])


def between(poses: Poses, span: int, fraction: float) -> Poses:
    """Poses of the shapes within a span, in float64: linear in position, slerp in rotation."""
    position, (start, end) = poses[0], poses[1][span : span + 2]
    quaternions = [[transformations.quaternion_from_matrix(r) for r in pair] for pair in zip(start, end, strict=True)]
    turned = [transformations.quaternion_slerp(*pair, fraction) for pair in quaternions]
    rotation = np.array([transformations.quaternion_matrix(q)[:3, :3] for q in turned]).reshape(-1, 9)
    return (1 - fraction) * position[span] + fraction * position[span + 1], rotation


def all_hits(world: World, rays: Rays) -> Hits:
    visible = wp.full(world.geometry.kind.size, True, dtype=wp.bool, device="cpu")
    hits = cast(world.geometry, visible, rays, np.inf, CULL_NONE)
    return Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy())


def cast_one_by_one(plan: Plan, poses: list[Poses], rays: Rays) -> Hits:
    """Cast every firing through a scene that stands still at the poses of that moment."""
    world, found = World(plan.trees, plan.shapes, "cpu"), []
    assert rays.firing is not None
    assert rays.span is not None
    assert rays.fraction is not None
    firing_of_ray, directions = rays.firing.numpy(), rays.directions.numpy()
    for w, own in enumerate(poses):
        spans = len(own[0]) - 1
        for k in range(FIRINGS):
            at = w * FIRINGS + k
            world.update(*between(own, int(rays.span.numpy()[at]) - spans * w, float(rays.fraction.numpy()[at])))
            alone = Rays(
                wp.array(directions[firing_of_ray == k], dtype=wp.vec3d, device="cpu"),
                wp.zeros(1, dtype=wp.vec3d, device="cpu"),
                rays.position[at : at + 1],
                rays.rotation[at : at + 1],
            )
            found.append(all_hits(world, alone))
    return Hits(*(np.concatenate(each) for each in zip(*found, strict=True)))


def assert_near(got: Hits, expected: Hits, message: str) -> None:
    """Assert that hits are equal, with distances to a few ulps, as poses differ by 1e-15.

    One ray in a thousand may pass an edge on the other side.
    """
    same = got.shape == expected.shape
    assert same.mean() > 0.999, f"{message}: {np.flatnonzero(~same)} differ"
    hit = same & (got.shape >= 0)
    np.testing.assert_allclose(got.distance[hit], expected.distance[hit], rtol=2e-6, err_msg=message)
    np.testing.assert_allclose(got.normal[hit], expected.normal[hit], atol=1e-5, err_msg=message)


@CAST
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("instants", [2, 5])
def test_each_ray_meets_the_shapes_where_they_are_at_its_time(seed: int, instants: int, packets: bool) -> None:
    plan = random_plan(seed)
    poses = moving(plan, seed, instants)
    world = World(plan.trees, plan.shapes, "cpu")
    world.sweep(*poses)
    rays = fired(seed, instants - 1, packets)
    got = all_hits(world, rays)
    assert_near(got, cast_one_by_one(plan, [poses], rays), f"seed {seed}")
    assert (got.shape >= 0).mean() > 0.1


@CAST
def test_many_worlds_move_each_by_itself(packets: bool) -> None:
    plan = random_plan(3)
    poses = [moving(plan, seed, 3) for seed in range(4)]
    poses = [(position + np.array([0, 0, 0.3 * w]), rotation) for w, (position, rotation) in enumerate(poses)]
    world = World(plan.trees, plan.shapes, "cpu")
    world.sweep(np.array([p for p, _ in poses]), np.array([r for _, r in poses]))
    rays = fired(3, 2, packets, worlds=4)
    assert_near(all_hits(world, rays), cast_one_by_one(plan, poses, rays), "four worlds")


@CAST
def test_what_rests_is_hit_bit_for_bit_as_in_a_frozen_world(packets: bool) -> None:
    plan = random_plan(4)
    position, rotation = plan.poses()
    frozen, swept = plan.world(), World(plan.trees, plan.shapes, "cpu")
    swept.sweep(np.array([position, position]), np.array([rotation, rotation]))
    rays = fired(4, 1, packets)
    assert_same(all_hits(swept, rays), all_hits(frozen, rays))


@CAST
def test_what_stands_still_is_placed_once_and_hit_bit_for_bit_as_if_it_moved(packets: bool) -> None:
    """A third of the shapes stands still in all worlds, another third in some; those given on the device all move."""
    plan = random_plan(5)
    poses = [moving(plan, seed, 3) for seed in range(4)]
    position, rotation = (np.array(each).reshape(4, 3, len(plan.kind), -1) for each in zip(*poses, strict=True))
    for values in (position, rotation):
        values[:, :, ::3] = values[:, :1, ::3]
        values[:2, :, 1::3] = values[:2, :1, 1::3]
    by_host, on_device = (World(plan.trees, plan.shapes, "cpu") for _ in range(2))
    by_host.sweep(position, rotation)
    matrices = rotation.reshape(4, 3, -1, 3, 3)
    on_device.sweep(wp.array(position, dtype=wp.vec3d, device="cpu"), wp.array(matrices, dtype=wp.mat33d, device="cpu"))
    assert by_host.geometry.movers.size == len(plan.kind) - len(plan.kind[::3])
    assert on_device.geometry.movers.size == len(plan.kind)
    rays = fired(5, 2, packets, worlds=4)
    assert_same(all_hits(by_host, rays), all_hits(on_device, rays))
    for each in (by_host, on_device):
        each.update(position[:, 0], rotation[:, 0])
    frozen = replace(rays, span=None, fraction=None)
    assert_same(all_hits(by_host, frozen), all_hits(on_device, frozen))


@pytest.mark.parametrize("angle", [0.1, 1.0, 3.1])
def test_no_hit_is_lost_however_far_shapes_turn(angle: float) -> None:
    """Long and thin shapes off their own origins; boxes around both ends, without the bulge, would lose many hits."""
    rng = np.random.default_rng(0)
    plan = Plan()
    for _ in range(12):
        plan.add_mesh(cube()._replace(vertices=np.array(cube().vertices * (1.5, 0.05, 0.05) + (2, 0, 0), np.float32)))
        plan.add(BOX, (2.0, 0.05, 0.05))
        plan.add(CAPSULE, (0.05, 1.5, 0))
    count = len(plan.kind)
    start = random_rotations(rng, count)
    turn = rotation_about(rng.normal(size=(count, 3)), np.full(count, angle))
    position = rng.uniform(-3, 3, (count, 3))
    poses = np.array([position, position + rng.normal(size=(count, 3))]), np.array([start, turn @ start])
    world = World(plan.trees, plan.shapes, "cpu")
    world.sweep(*poses)
    for seed in range(4):
        rays = fired(seed, 1, packets=False)
        expected = cast_one_by_one(plan, [poses], rays)
        assert_near(all_hits(world, rays), expected, f"seed {seed}")
        assert (expected.shape >= 0).mean() > 0.1


@CAST
def test_unbounded_planes_are_hit_while_they_slide(packets: bool) -> None:
    plan = Plan()
    for height in (-2.5, -4.0, -6.0):
        plan.add(PLANE, (0, 0, 0), (0, 0, height))
        plan.add(SPHERE, (0.3, 0, 0), (height, 1, 0))
    position, rotation = (np.array([each] * 2) for each in plan.poses())
    position[1, 2] += 2, 0, 3
    world = World(plan.trees, plan.shapes, "cpu")
    world.sweep(position, rotation)
    rays = fired(6, 1, packets)
    got = all_hits(world, rays)
    assert_near(got, cast_one_by_one(plan, [(position, rotation.reshape(2, -1, 3, 3))], rays), "planes")
    assert {0, 2} <= set(got.shape)


def test_an_unbounded_plane_that_is_turned_over_is_hit_on_the_way() -> None:
    """It has the same thin box before and after, and stands upright halfway."""
    plan = Plan()
    plan.add(PLANE, (0, 0, 0))
    world = World(plan.trees, plan.shapes, "cpu")
    world.sweep(np.zeros((2, 1, 3)), np.array([np.eye(3), np.diag([1.0, -1, -1])])[:, None])
    rays = Rays(
        wp.array([(0, 1, 0), (0, -1, 0)], dtype=wp.vec3d, device="cpu"),
        wp.array([(0, -5, 2), (0, 5, 2)], dtype=wp.vec3d, device="cpu"),
        wp.zeros(1, dtype=wp.vec3d, device="cpu"),
        wp.array([np.eye(3)], dtype=wp.mat33d, device="cpu"),
        span=wp.zeros(1, dtype=int, device="cpu"),
        fraction=wp.array([0.5], dtype=wp.float64, device="cpu"),
    )
    np.testing.assert_allclose(sorted(all_hits(world, rays).distance), [5, np.inf], rtol=1e-6)


def test_a_shape_without_a_pose_at_one_end_is_not_hit_in_that_span() -> None:
    plan = Plan()
    plan.add(SPHERE, (1, 0, 0), (0, 0, -3))
    plan.add(SPHERE, (1, 0, 0), (0, 0, -9))
    world = World(plan.trees, plan.shapes, "cpu")
    position = np.array([plan.poses()[0]] * 3)
    position[2, 0] = np.nan
    world.sweep(position, np.array([plan.poses()[1]] * 3))
    down = np.array([[0, 0, -1.0]] * 2)
    rays = Rays(
        wp.array(down, dtype=wp.vec3d, device="cpu"),
        wp.zeros(1, dtype=wp.vec3d, device="cpu"),
        wp.zeros(2, dtype=wp.vec3d, device="cpu"),
        wp.array([np.eye(3)] * 2, dtype=wp.mat33d, device="cpu"),
        firing=wp.array([0, 1], dtype=int, device="cpu"),
        span=wp.array([0, 1], dtype=int, device="cpu"),
        fraction=wp.array([0.9, 0.1], dtype=wp.float64, device="cpu"),
    )
    np.testing.assert_array_equal(all_hits(world, rays).shape, [0, 1])


@pytest.mark.parametrize("seed", range(2))
def test_firings_are_sorted_into_tiles_of_their_own(seed: int) -> None:
    rng = np.random.default_rng(seed)
    directions = unit(rng.normal((5, 0, 0), size=(3000, 3)))
    firing: NDArray[np.int32] = rng.permutation(np.repeat(np.arange(4), 750)).astype(np.int32)
    packets = sort_into_packets(directions, firing)
    numbers, one = packets.packets.numpy()["ray"].reshape(packets.tiles.size, -1), packets.tiles.numpy()["ray"]
    assert sorted([*numbers[numbers >= 0], *packets.singles.numpy()]) == list(range(3000))
    for rays, of_tile in zip(numbers, one, strict=True):
        assert set(firing[rays[rays >= 0]]) == {firing[of_tile]}
