"""Packets of consecutive rays, and of rays from several origins, have the hits of single rays."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_worlds import Doubles, Hits, assert_same, random_plan, random_rotations, rays_of, unit
from numpy.typing import NDArray

from rigcast.kernels.cast import cast
from rigcast.kernels.effects.cameras.stereo import StereoPair, second_view
from rigcast.kernels.packets.packet import LANES, PACKETS
from rigcast.kernels.packing.firings import groups_of
from rigcast.kernels.packing.in_order import pack_in_order
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.packing.steered import steered
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.rays.coherent import Packets
from rigcast.kernels.shapes.triangle import CULL_NONE
from rigcast.kernels.world.world import World

SEED = 6


def path(count: int, turns: float = 8.0) -> Doubles:
    """Directions of a beam that winds around +x."""
    along = np.linspace(0, 1, count)
    aside, angle = 0.6 * np.sin(17 * along), 2 * np.pi * turns * along
    return unit(np.stack([np.ones(count), aside * np.cos(angle), aside * np.sin(angle)], axis=-1))


def vectors(values: Doubles) -> wp.array:
    return wp.array(values, dtype=wp.vec3d, device="cpu")


def hits_of(world: World, rays: Rays) -> Hits:
    visible = wp.full(world.geometry.kind.size, True, dtype=wp.bool, device="cpu")
    hits = cast(world.geometry, visible, rays, np.inf, CULL_NONE)
    return Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy())


def assert_every_ray_is_in_one_place(packets: Packets, group: NDArray[np.int32]) -> None:
    """Assert that every ray is in one lane or single, and that the rays of a tile are of one group."""
    numbers = packets.packets.numpy()["ray"].reshape(packets.tiles.size, PACKETS * LANES)
    assert sorted([*numbers[numbers >= 0], *packets.singles.numpy()]) == list(range(len(group)))
    for rays, one in zip(numbers, packets.tiles.numpy()["ray"], strict=True):
        assert set(group[rays[rays >= 0]]) == {group[one]}


GROUPS: dict[str, NDArray[np.int32]] = {
    "one": np.zeros(3001, np.int32),
    "a few rays each": (np.arange(3001) // 24).astype(np.int32),
    "more than a tile each": (np.arange(3001) // 700).astype(np.int32),
    "mixed": np.random.default_rng(0).integers(0, 5, 3001).astype(np.int32),
}


@pytest.mark.parametrize("name", GROUPS)
def test_rays_in_order_are_in_one_place_each(name: str) -> None:
    group = GROUPS[name]
    packets = pack_in_order(vectors(path(len(group), turns=1)), None if name == "one" else group)
    assert packets.singles.size == 0
    assert_every_ray_is_in_one_place(packets, group)


@pytest.mark.parametrize("name", GROUPS)
def test_rays_are_packed_in_the_order_that_is_given(name: str) -> None:
    """In their shuffled order all of these rays would be cast singly."""
    group = GROUPS[name]
    shuffled = np.random.default_rng(2).permutation(len(group)).astype(np.int32)
    directions = vectors(path(len(group), turns=1)[shuffled])
    order = np.argsort(shuffled).astype(np.int32)
    packets = pack_in_order(directions, None if name == "one" else group[shuffled], order)
    assert packets.singles.size == 0
    assert_every_ray_is_in_one_place(packets, group[shuffled])


def test_none_in_order_are_no_packets() -> None:
    packets = pack_in_order(vectors(np.empty((0, 3))))
    assert packets.tiles.size == packets.packets.size == packets.singles.size == 0


def test_rays_that_do_not_follow_a_path_go_alone() -> None:
    """The first 640 follow a path; one of the others is NaN."""
    directions = np.concatenate([path(640, turns=2), unit(np.random.default_rng(1).normal(size=(1000, 3)))])
    directions[900] = np.nan
    packets = pack_in_order(vectors(directions))
    assert sorted(packets.singles.numpy()) == list(range(640, 1640))
    assert_every_ray_is_in_one_place(packets, np.zeros(1640, np.int32))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", GROUPS)
def test_rays_in_order_hit_what_they_hit_alone(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    world, directions = random_plan(seed).world(), path(3001, turns=rng.uniform(1, 80))
    position = vectors(rng.uniform(-3, 3, (1, 3)))
    rotation = wp.array(random_rotations(rng, 1), dtype=wp.mat33d, device="cpu")
    alone = replace(rays_of(np.zeros(3), directions), position=position, rotation=rotation)
    packets = pack_in_order(alone.directions, None if name == "one" else GROUPS[name])
    got, expected = hits_of(world, replace(alone, packets=packets)), hits_of(world, alone)
    assert_same(got, expected, f"seed {seed}")
    assert np.isfinite(got.distance).any()


@pytest.mark.parametrize("seed", range(3))
def test_rays_from_several_origins_hit_what_they_hit_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world, directions = random_plan(seed).world(), path(2000)
    origins = rng.uniform(-1, 1, (5, 3))[rng.integers(0, 5, 2000)]
    alone = rays_of(origins, directions)
    rotation = wp.array(random_rotations(rng, 1), dtype=wp.mat33d, device="cpu")
    alone = replace(alone, position=vectors(rng.uniform(-3, 3, (1, 3))), rotation=rotation)
    group = groups_of(alone)
    assert group is not None
    packets = sort_into_packets(alone.directions.numpy(), group)
    assert_every_ray_is_in_one_place(packets, group)
    assert packets.tiles.size > 0
    assert_same(hits_of(world, replace(alone, packets=packets)), hits_of(world, alone), f"seed {seed}")


@pytest.mark.parametrize("firings", [1, 6])
@pytest.mark.parametrize("seed", range(3))
def test_rays_from_the_second_imager_hit_what_they_hit_alone(seed: int, firings: int) -> None:
    """They are packed in the order of the camera's rays, those that hit nothing included."""
    rng = np.random.default_rng(seed)
    world, pair = random_plan(seed).world(), StereoPair()
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 60), np.linspace(-0.4, 0.4, 40))
    directions = unit(np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3))
    firing = None if firings == 1 else (np.arange(len(directions)) * firings // len(directions)).astype(np.int32)
    pair.baseline = rng.uniform(-0.1, 0.1)
    rays = replace(
        rays_of(np.zeros(3), directions),
        position=vectors(rng.uniform(-3, 3, (firings, 3))),
        rotation=wp.array(random_rotations(rng, firings), dtype=wp.mat33d, device="cpu"),
        packets=sort_into_packets(directions, firing),
        firing=None if firing is None else wp.array(firing, dtype=int, device="cpu"),
    )
    visible = wp.full(world.geometry.kind.size, True, dtype=wp.bool, device="cpu")
    limit = float(np.median(hits_of(world, rays).distance))
    seen = cast(world.geometry, visible, rays, limit, CULL_NONE)
    assert 0 < np.isfinite(seen.distance.numpy()).sum() < len(directions), f"seed {seed}"
    view = second_view(seen, rays, pair).rays
    assert isinstance(view.packets, Packets)
    assert view.packets.tiles.size > 0
    assert_every_ray_is_in_one_place(view.packets, np.zeros(len(directions), np.int32) if firing is None else firing)
    assert_same(hits_of(world, view), hits_of(world, replace(view, packets=None)), f"seed {seed}")


@pytest.mark.parametrize("std", [0.001, 0.02, 0.3])
@pytest.mark.parametrize("origins", ["one", "of rows", "of rows, from one"])
@pytest.mark.parametrize("firings", [1, 6])
def test_steered_rays_hit_what_they_hit_alone(firings: int, origins: str, std: float) -> None:
    """They are packed in the order of the original rays; some directions are NaN."""
    rng = np.random.default_rng(SEED)
    elevation, azimuth = np.meshgrid(np.linspace(-0.4, 0.4, 12), np.linspace(-1, 1, 150), indexing="ij")
    flat = np.cos(elevation)
    directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
    count = len(directions)
    of_rows = vectors(rng.uniform(-0.1, 0.1, (4, 3))[np.arange(count) // 150 % 4])
    firing = None if firings == 1 else (np.arange(count) % 150 * firings // 150).astype(np.int32)
    rays = replace(
        rays_of(np.zeros(3), directions),
        position=vectors(rng.uniform(-3, 3, (firings, 3))),
        rotation=wp.array(random_rotations(rng, firings), dtype=wp.mat33d, device="cpu"),
        firing=None if firing is None else wp.array(firing, dtype=int, device="cpu"),
    )
    if origins == "of rows":
        rays = replace(rays, origins=of_rows)
    rays = replace(rays, packets=sort_into_packets(directions, groups_of(rays)))
    turned = unit(directions + rng.normal(scale=std, size=directions.shape))
    turned[rng.random(count) < 0.005] = np.nan
    got = steered(rays, vectors(turned), of_rows if origins == "of rows, from one" else None)
    assert isinstance(got.packets, Packets)
    assert got.packets.tiles.size > 0 or std > 0.1
    group = groups_of(got)
    assert_every_ray_is_in_one_place(got.packets, np.zeros(count, np.int32) if group is None else group)
    world = random_plan(SEED).world()
    assert_same(hits_of(world, got), hits_of(world, replace(got, packets=None)), f"seed {SEED}")


def test_groups_have_one_origin_and_one_firing() -> None:
    origins = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 0, 0]], float)
    rays, firing = rays_of(origins, np.eye(3)[[0] * 5]), wp.array([0, 0, 0, 1, 1], dtype=int, device="cpu")
    together = groups_of(rays)
    assert together is not None
    assert [together[0] == together[k] for k in range(5)] == [True, False, True, False, True]
    apart = groups_of(replace(rays, firing=firing))
    assert apart is not None
    assert len(set(apart)) == 4
    assert apart[0] == apart[2]
    one_origin = replace(rays, origins=rays.origins[:1])
    assert groups_of(one_origin) is None
    np.testing.assert_array_equal(groups_of(replace(one_origin, firing=firing)), firing.numpy())
