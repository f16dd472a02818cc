"""Worlds of every kind with rays through them, on which all ways to cast must agree."""

from collections.abc import Callable

import numpy as np
import warp as wp
from made_worlds import (
    Doubles,
    Mesh,
    Plan,
    cube,
    field,
    grid,
    icosphere,
    random_plan,
    random_rays,
    rays_of,
    turned,
    unit,
)
from moving_worlds import fired, moving
from scattered_worlds import scattered, sensor, sensor_poses

from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes import solids
from rigcast.kernels.world.world import World

RAYS = 3000
Scene = tuple[World, Rays]


def shapes_of_every_kind() -> Scene:
    return random_plan(0).world(), rays_of(*random_rays(0, RAYS))


def rays_from_within_shapes() -> Scene:
    plan = random_plan(1)
    rng = np.random.default_rng(1)
    middles = np.array(plan.position)[rng.integers(0, len(plan.position), RAYS)]
    return plan.world(), rays_of(middles + rng.normal(scale=0.05, size=middles.shape), random_rays(1, RAYS)[1])


def sheets() -> Scene:
    plan = Plan()
    for seed in range(20):
        plan.add_mesh(turned(grid(8, 0.1, seed), seed), np.random.default_rng(seed).uniform(-4, 4, 3))
        plan.kind[-1] = solids.SHEET
    return plan.world(), rays_of(*random_rays(2, RAYS))


def rays_at(shape: Mesh, seed: int, near: float, far: float) -> tuple[Doubles, Doubles]:
    """Rays at a mesh's vertices, and at points on its edges and faces, from near to far [m] away; some run in the plane
    of a face."""
    rng = np.random.default_rng(seed)
    corners = shape.corners.astype(np.float64)[rng.integers(0, len(shape.faces), RAYS)]
    share = rng.dirichlet((1, 1, 1), RAYS)
    share[::3] = 1, 0, 0
    share[1::3, 2] = 0
    share /= share.sum(axis=1, keepdims=True)
    targets = (share[..., None] * corners).sum(axis=1)
    away = unit(rng.normal(size=targets.shape))
    away[::10] = unit(corners[::10, 1] - corners[::10, 2])
    origins = targets + away * np.exp(rng.uniform(np.log(near), np.log(far), (RAYS, 1)))
    return origins, unit(targets - origins)


def rays_at_a_height_field() -> Scene:
    plan = Plan()
    hills = field(23, 34, 0.3)
    plan.add_tree(hills.tree)
    return plan.world(), rays_of(*rays_at(hills.mesh, 3, 0.1, 100.0))


def rays_at_a_mesh() -> Scene:
    plan, shape = Plan(), turned(icosphere(4), 4)
    plan.add_mesh(shape)
    return plan.world(), rays_of(*rays_at(shape, 4, 1e-3, 1e3))


def rays_at_a_small_mesh_far_from_its_origin() -> Scene:
    """Rounding errors of vertices are about a hundredth of a triangle's size."""
    plan, ball = Plan(), icosphere(3)
    shape = Mesh((ball.vertices + np.float32(3e3)).astype(np.float32), ball.faces)
    plan.add_mesh(shape)
    return plan.world(), rays_of(*rays_at(shape, 5, 0.1, 1e4))


def rays_at_a_tiny_mesh() -> Scene:
    plan, ball = Plan(), icosphere(2)
    shape = Mesh(ball.vertices * np.float32(1e-5), ball.faces)
    plan.add_mesh(shape)
    return plan.world(), rays_of(*rays_at(shape, 6, 1e-6, 1.0))


def rays_along_faces_of_boxes() -> Scene:
    """From corners, edges and faces of cubes side by side, along the axes and their diagonals."""
    plan, rng = Plan(), np.random.default_rng(7)
    plan.add_mesh(cube())
    for x in range(2, 9, 2):
        plan.add_mesh(0, (x, 0, 0)) if x % 4 else plan.add(solids.BOX, (1, 1, 1), (x, 0, 0))
    directions = rng.integers(-1, 2, (RAYS, 3)).astype(np.float64)
    directions[(directions == 0).all(axis=1)] = 1, 0, 0
    return plan.world(), rays_of(rng.integers(-12, 13, (RAYS, 3)), unit(directions))


def a_world_far_from_its_origin() -> Scene:
    plan, away = random_plan(8), np.array([1e6, -2e6, 3e5])
    plan.position = [at + away for at in plan.position]
    origins, directions = random_rays(8, RAYS)
    return plan.world(), rays_of(origins + away, directions)


def lost_shapes() -> Scene:
    """Shapes of which some have a pose that is not finite."""
    plan = random_plan(9)
    position, rotation = plan.poses()
    position[::3, 1], rotation[1::5, 4] = np.nan, np.inf
    world = World(plan.trees, plan.shapes, "cpu")
    world.update(position, rotation)
    return world, rays_of(*random_rays(9, RAYS))


def many_worlds() -> Scene:
    plan = random_plan(10)
    world = plan.world()
    world.update(*scattered(plan, 10))
    return world, sensor(*sensor_poses(10), packets=False)


def many_worlds_that_move() -> Scene:
    plan = random_plan(11)
    world = World(plan.trees, plan.shapes, "cpu")
    poses = [moving(plan, seed, 3) for seed in range(4)]
    world.sweep(np.array([p for p, _ in poses]), np.array([r for _, r in poses]))
    return world, fired(11, 2, packets=False, worlds=4)


def rays_that_are_not_finite() -> Scene:
    origins, directions = random_rays(12, RAYS)
    origins[::3, 0], directions[1::3, 1] = np.nan, np.inf
    return random_plan(12).world(), rays_of(origins, directions)


def no_shapes() -> Scene:
    return Plan().world(), rays_of(*random_rays(13, RAYS))


SCENES: tuple[Callable[[], Scene], ...] = (
    shapes_of_every_kind,
    rays_from_within_shapes,
    sheets,
    rays_at_a_height_field,
    rays_at_a_mesh,
    rays_at_a_small_mesh_far_from_its_origin,
    rays_at_a_tiny_mesh,
    rays_along_faces_of_boxes,
    a_world_far_from_its_origin,
    lost_shapes,
    many_worlds,
    many_worlds_that_move,
    rays_that_are_not_finite,
    no_shapes,
)


def every_seventh_is_hidden(world: World) -> wp.array:
    return wp.array(np.arange(len(world.geometry.kind)) % 7 != 3, dtype=wp.bool, device="cpu")
