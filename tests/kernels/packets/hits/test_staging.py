"""The hits of packets are written to the caller's arrays, row by row or one by one."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_rays import PATTERNS
from made_worlds import Doubles, Hits, assert_same, random_plan, random_rotations, rays_of

from rigcast.kernels.cast import cast
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.packets import cast as casting
from rigcast.kernels.packets.packet import LANES, PACKETS
from rigcast.kernels.packing.in_order import pack_in_order
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.coherent import Packets
from rigcast.kernels.shapes.triangle import CULL_NONE

WORLDS = 2


def packed_in_order(directions: Doubles) -> Packets:
    return pack_in_order(wp.array(directions, dtype=wp.vec3d, device="cpu"))


def as_numpy(hits: HitArrays) -> Hits:
    return Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy())


@pytest.mark.parametrize("pack", [sort_into_packets, packed_in_order])
@pytest.mark.parametrize("name", PATTERNS)
def test_a_tile_has_the_rows_of_its_packets(name: str, pack: Callable[[Doubles], Packets]) -> None:
    packets = pack(PATTERNS[name])
    numbers = packets.packets.numpy()["ray"].reshape(-1, PACKETS, LANES)
    for tile, of_packets in zip(packets.tiles.numpy(), numbers, strict=True):
        in_squares = of_packets.reshape(2, 4, 4, 4).swapaxes(1, 2).reshape(PACKETS, LANES)
        rows = tile["rows"][:, None] + np.arange(LANES)
        found = [
            side for side, rays in ((1, of_packets), (4, in_squares)) if (rays == rays[:, :1] + np.arange(16)).all()
        ]
        assert [tile["across"]] == (found if (of_packets >= 0).all() and found else [0])
        if tile["across"]:
            np.testing.assert_array_equal(rows, of_packets if tile["across"] == 1 else in_squares)


@pytest.mark.parametrize(
    ("name", "across"), [("rows far apart", {1}), ("camera", {4}), ("camera of odd size", {0, 4}), ("all around", {0})]
)
@pytest.mark.parametrize("streamed_from", [0, 2**40], ids=["streamed", "not streamed"])
@pytest.mark.parametrize("before", [0, 1, 4])
def test_hits_are_written_wherever_arrays_begin(
    name: str, across: set[int], streamed_from: int, before: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Arrays begin on a cache line or not; several worlds are written; nothing before or after the hits changes."""
    monkeypatch.setattr(casting, "STREAMED_FROM", streamed_from)
    world, directions, rng = random_plan(2).world(), PATTERNS[name], np.random.default_rng(2)
    packets = sort_into_packets(directions)
    assert set(packets.tiles.numpy()["across"]) == across
    alone = replace(
        rays_of(np.zeros(3), directions),
        position=wp.array(rng.uniform(-1, 1, (WORLDS, 3)), dtype=wp.vec3d, device="cpu"),
        rotation=wp.array(random_rotations(rng, WORLDS), dtype=wp.mat33d, device="cpu"),
        span=wp.zeros(WORLDS, dtype=int, device="cpu"),
        worlds=WORLDS,
    )
    seen = wp.full(len(world.geometry.kind), True, dtype=wp.bool, device="cpu")
    expected = as_numpy(cast(world.geometry, seen, alone, 6.0, CULL_NONE))
    every = HitArrays.empty(before + alone.total + 1, "cpu")
    every.distance.fill_(7.0)
    own = slice(before, before + alone.total)
    out = HitArrays(every.distance[own], every.shape[own], every.face[own], every.normal[own])
    got = as_numpy(cast(world.geometry, seen, replace(alone, packets=packets), 6.0, CULL_NONE, out))
    assert_same(got, expected)
    assert 0 < np.isfinite(got.distance).mean() < 1
    np.testing.assert_array_equal(np.delete(every.distance.numpy(), np.r_[own]), np.full(before + 1, 7.0))
