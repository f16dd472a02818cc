"""Rays in warps: each is in one warp, with its neighbours, and has the hit of a single ray."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_worlds import Doubles, Hits, assert_same, random_plan, rays_of, unit

from rigcast.kernels.cast import cast
from rigcast.kernels.packing.warps import LEVEL, WARP, sort_into_warps
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.triangle import CULL_NONE
from rigcast.kernels.world.world import World

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]


def table(rows: int, columns: int) -> Doubles:
    """The rays of a lidar, row by row."""
    elevation, azimuth = np.meshgrid(
        np.linspace(-0.6, 0.6, rows), 2 * np.pi * np.arange(columns) / columns, indexing="ij"
    )
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)


PATTERNS = {
    "no ray": np.empty((0, 3)),
    "one": table(1, 1),
    "fewer than a warp": table(1, 7),
    "a warp and one": table(1, WARP + 1),
    "a small lidar": table(16, 64),
    "a lidar": table(64, 1024),
    "anywhere": unit(np.random.default_rng(0).normal(size=(5000, 3))),
}


@pytest.mark.parametrize("name", PATTERNS)
def test_each_ray_is_there_once(name: str) -> None:
    order = sort_into_warps(PATTERNS[name], "cpu").order.numpy()
    np.testing.assert_array_equal(np.sort(order), np.arange(len(PATTERNS[name])))


@pytest.mark.parametrize(("name", "narrower"), [("a small lidar", 3.0), ("a lidar", 2.0), ("anywhere", 5.0)])
def test_rays_of_a_warp_are_closer_together_than_those_of_a_row(name: str, narrower: float) -> None:
    directions = PATTERNS[name][: len(PATTERNS[name]) // WARP * WARP]
    order = sort_into_warps(directions, "cpu").order.numpy()
    assert narrower * width(directions[order]) < width(directions)


def test_warps_of_a_lidar_are_flat() -> None:
    """Warps of a small lidar, whose rows and columns have about the same spacing, have at most four rows."""
    order = sort_into_warps(PATTERNS["a small lidar"], "cpu", LEVEL).order.numpy().reshape(-1, WARP)
    rows = [len(set(warp // 64)) for warp in order]
    assert max(rows) <= 4, rows
    assert np.mean(rows) < 3, rows


def width(directions: Doubles) -> float:
    """Mean square of the distances of WARP consecutive directions from their mean."""
    warps = directions.reshape(-1, WARP, 3)
    return float(np.square(warps - warps.mean(axis=1, keepdims=True)).sum(axis=2).mean())


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("worlds", [1, 3])
def test_they_hit_what_they_hit_one_after_the_other(worlds: int, device: str) -> None:
    directions = PATTERNS["anywhere"]
    rays = replace(
        rays_of((0.3, 0.2, 0.1), directions, device),
        position=wp.array(np.zeros((worlds, 3)), dtype=wp.vec3d, device=device),
        rotation=wp.array(np.tile(np.eye(3), (worlds, 1, 1)), dtype=wp.mat33d, device=device),
        worlds=worlds,
    )
    world = random_plan(4).world(device)
    if worlds > 1:
        pose = random_plan(4).poses()
        position = np.stack([pose[0] + 0.1 * k for k in range(worlds)])
        world.update(position, np.broadcast_to(pose[1].reshape(-1, 3, 3), (*position.shape, 3)))
    assert_same(hits_of(world, replace(rays, packets=sort_into_warps(directions, device))), hits_of(world, rays))


def hits_of(world: World, rays: Rays) -> Hits:
    seen = wp.full(world.geometry.kind.size, True, dtype=wp.bool, device=rays.directions.device)
    hits = cast(world.geometry, seen, rays, np.inf, CULL_NONE)
    assert (hits.distance.numpy() < np.inf).any()
    return Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy())
