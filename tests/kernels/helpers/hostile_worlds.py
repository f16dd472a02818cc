"""Worlds that could crash or hang a process; run as a script, which prints the name of each before it begins."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from made_worlds import Mesh, Plan, assert_same, cast_through, random_plan, random_rays
from numpy.typing import NDArray

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.shapes.solids import BOX, SPHERE
from rigcast.kernels.trees.tree import build_tree
from rigcast.kernels.world.arrays import Shapes
from rigcast.kernels.world.world import World

SEEDS = range(4)


def random_bits(seed: int, shape: tuple[int, ...], dtype: type = np.float32) -> NDArray[Any]:
    """Floating-point numbers of random bits: NaN, inf, subnormal and all sizes in between."""
    raw = np.dtype(f"u{np.dtype(dtype).itemsize}")
    return np.random.default_rng(seed).integers(0, np.iinfo(raw).max, shape, raw, endpoint=True).view(dtype)


def triangles_of_random_bits() -> None:
    for seed in SEEDS:
        vertices = random_bits(seed, (12000, 3))
        vertices = vertices[(np.abs(vertices) <= FARTHEST).all(axis=1)][:4500].astype(np.float32)
        plan = Plan()
        plan.add_mesh(Mesh(vertices, np.arange(4500).reshape(-1, 3)))
        world, (origins, directions) = plan.world(), random_rays(seed, 1000)
        for scale in (0.0, 1e-30, 1.0, 1e10, 1e17, 1e19, 1e200):
            got = cast_through(world, scale * origins, directions)
            assert (got.shape >= -1).all(), (seed, scale)
            assert (got.shape <= 0).all(), (seed, scale)


def boxes_of_random_bits() -> None:
    for seed in SEEDS:
        a, b = random_bits(seed, (5000, 3)), random_bits(seed + 100, (5000, 3))
        for lower, upper in ((a, b), (np.fmin(a, b), np.fmax(a, b))):
            tree = build_tree(lower, upper, leaf_size=1)
            assert sorted(tree.order) == list(range(5000)), seed


def poses_of_random_bits() -> None:
    """Also huge, infinite and NaN positions; with good poses afterwards the hits are those of before."""
    for seed in SEEDS:
        plan = random_plan(seed, 100)
        (position, rotation), rays = plan.poses(), random_rays(seed, 1000)
        world, count = plan.world(), len(plan.kind)
        expected = cast_through(world, *rays)
        doubles = random_bits(seed, (count, 3), np.float64), random_bits(seed + 1, (count, 9), np.float64)
        floats = random_bits(seed, (count, 3)).astype(np.float64), random_bits(seed + 1, (count, 9)).astype(np.float64)
        huge = [(position + far, rotation) for far in (1e17, 1e19, 1e30, 1e38, 1e300, np.inf, np.nan)]
        stray = np.where(np.arange(count)[:, None] == 5, 0.9e18, position)
        bad = [doubles, floats, (position, doubles[1]), (doubles[0], rotation), *huge, (stray, rotation)]
        for k, poses in enumerate([*bad, (1e10 * position, 1e10 * rotation)]):
            world.update(*poses)
            got = cast_through(world, *rays)
            assert ((got.shape >= -1) & (got.shape < count)).all(), (seed, k)
            world.update(position, rotation)
            assert_same(cast_through(world, *rays), expected, f"seed {seed}, poses {k}")


def a_million_shapes() -> None:
    """Boxes on a line, one metre apart."""
    count, ones = 1_000_000, np.ones((1_000_000, 3), np.float32)
    shapes = Shapes(np.full(count, BOX, np.int32), 0.25 * ones, np.full(count, -1, np.int32), 0 * ones, 0.26 * ones)
    world = World([], shapes, "cpu")
    position = np.arange(count)[:, None] * [1.0, 0.0, 0.0]
    world.update(position, np.tile(np.eye(3).ravel(), (count, 1)))
    wanted = np.random.default_rng(0).integers(0, count, 1000)
    got = cast_through(world, position[wanted] + [0, 0, 2], (0, 0, -1))
    assert (got.shape == wanted).all()
    assert (got.distance == 1.75).all()


def spheres_nested_two_hundred_deep() -> None:
    """Radii from 2^-59 to 2^59 m: rays from the common centre hit the smallest."""
    plan, radii = Plan(), 2.0 ** np.linspace(59, -59, 200)
    for radius in radii:
        plan.add(SPHERE, (radius, 0, 0))
    plan.add(0, (0, 0, 0), (0, 0, -1))  # an infinite plane: its tree and the spheres' are joined
    got = cast_through(plan.world(), (0, 0, 0), random_rays(0, 100)[1])
    assert (got.shape == 199).all()
    np.testing.assert_allclose(got.distance, radii[-1], rtol=1e-6)


ROWS: list[Callable[[], None]] = [
    triangles_of_random_bits,
    boxes_of_random_bits,
    poses_of_random_bits,
    a_million_shapes,
    spheres_nested_two_hundred_deep,
]

if __name__ == "__main__":
    wp.init()
    with np.errstate(all="ignore"):
        for row in ROWS:
            print(row.__name__, file=sys.stderr, flush=True)
            row()
    print("survived", file=sys.stderr)
