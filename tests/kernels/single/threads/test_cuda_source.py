"""The cast from Warp's source for CUDA, run on the CPU, has the bits of the CPU's own cast, and no ray leaks."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import several_casts
import warp as wp
import watertight
from cuda_source import CudaSource
from made_worlds import Hits, assert_same, random_plan, rays_of, unit
from various_scenes import SCENES, Scene, every_seventh_is_hidden, many_worlds

from rigcast.kernels import cast
from rigcast.kernels.geometry import Geometry, Patch
from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.kernels.single.threads import launches
from rigcast.kernels.single.threads.cast import BLOCK as THREADS
from rigcast.kernels.single.threads.cast import cast_rays
from rigcast.kernels.single.threads.launches import InThreads
from rigcast.kernels.single.threads.several import cast_rays_of_several
from rigcast.kernels.trees.fit import Fit
from rigcast.kernels.trees.nodes import Node, by_ends
from rigcast.kernels.world.refit_in_blocks import BLOCK, refit_in_blocks
from rigcast.kernels.world.top_level import Refit
from rigcast.kernels.world.unfolded import lead_to_nodes, nodes_of, patches_of
from rigcast.kernels.world.world import World

BLOCKS = 3
pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="no g++ to compile CUDA's source with")


@pytest.fixture(scope="module")
def source_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[wp.Kernel], CudaSource]:
    return cache(lambda kernel: CudaSource(kernel, tmp_path_factory.mktemp(kernel.key), THREADS))


@pytest.fixture
def begin_cuda(source_of: Callable[[wp.Kernel], CudaSource], monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """A function after whose call single rays are cast by CUDA's source. Blocks run one after the other: the first
    casts all rays, the others find none left."""

    def launch(source: CudaSource, geometry: Geometry, inputs: Sequence[Any]) -> None:
        trees = geometry.nodes, geometry.top
        nodes, top = (a.numpy() for a in trees)
        nodes = np.concatenate([lead_to_nodes(nodes, len(nodes)), nodes_of(geometry.patches.numpy())])
        geometry.nodes, geometry.top = (wp.array(by_ends(a), dtype=Node, device="cpu") for a in (nodes, top))
        source.launch(np.arange(BLOCKS), inputs)
        geometry.nodes, geometry.top = trees

    def record(kernel: wp.Kernel, count: int, inputs: Sequence[Any], *others: Any) -> Callable[[], None]:
        is_cast = kernel in {cast_rays, cast_rays_of_several}
        geometry = inputs[0 if is_cast else 1]
        geometry.patches = wp.array(
            patches_of(geometry.plots.numpy(), geometry.sides.numpy()), dtype=Patch, device="cpu"
        )
        if not is_cast:
            return recorded(kernel, count, inputs, *others)
        return lambda: launch(source_of(kernel), geometry, inputs)

    def begin() -> None:
        monkeypatch.setattr(cast, "_prepare_singles", cast._in_threads)
        monkeypatch.setattr(launches, "recorded", record)

    return begin


def hits_of(world: World, rays: Rays, limit: float = np.inf, cull: int = CULL_NONE) -> Hits:
    hits = cast.cast(world.geometry, every_seventh_is_hidden(world), rays, limit, cull)
    return Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy())


@pytest.mark.parametrize(("limit", "cull"), [(np.inf, CULL_NONE), (3.0, CULL_BACK), (np.inf, CULL_FRONT)])
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_it_hits_what_single_rays_hit(
    scene: Callable[[], Scene], limit: float, cull: int, begin_cuda: Callable[[], None]
) -> None:
    world, rays = scene()
    expected = hits_of(world, rays, limit, cull)
    begin_cuda()
    assert_same(hits_of(world, rays, limit, cull), expected)


def test_it_hits_what_packets_hit(begin_cuda: Callable[[], None]) -> None:
    directions = unit(np.random.default_rng(1).normal(size=(20_000, 3)))
    world, rays = random_plan(1).world(), rays_of((0.3, 0.2, 0.1), directions)
    expected = hits_of(world, replace(rays, packets=sort_into_packets(directions)))
    begin_cuda()
    assert_same(hits_of(world, rays), expected)


def test_sensors_read_at_once_what_each_reads_alone(begin_cuda: Callable[[], None]) -> None:
    begin_cuda()
    alone = [replace(rays, packets=None) for rays in several_casts.rays_of_sensors()]
    several_casts.check_at_once(random_plan(several_casts.SEED).world(), alone)


def test_casts_by_turns_with_others_are_prepared_once(
    begin_cuda: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    begin_cuda()
    world, prepared = random_plan(3).world(), list[int]()
    rays = [rays_of((0, 0, k), np.eye(3)) for k in range(3)]
    (a, _a), (b, _b), (c, _c) = several_casts.prepared(world, rays)
    prepare = launches._prepare

    def counting(casts: Sequence[InThreads]) -> list[Callable[[], None]]:
        prepared.append(len(casts))
        return prepare(casts)

    monkeypatch.setattr(launches, "_prepare", counting)
    for _ in range(3):
        for readings in ([a, b], [a, c], [a], [c, b]):
            cast.launch(readings)
    assert prepared == [2, 2, 1, 2]


@pytest.mark.parametrize("aim", ["points", "edges", "vertices", "all around"])
@pytest.mark.parametrize(("offset", "is_baked"), [(0.0, False), (1.5e5, False), (1.5e5, True)])
def test_no_ray_slips_through(aim: str, offset: float, is_baked: bool, begin_cuda: Callable[[], None]) -> None:
    placed = watertight.place("icosphere", 1.0, offset, is_baked)
    assert placed is not None
    begin_cuda()
    (leaked,), rays = watertight.count_leaks([placed], aim, 10_000, seed=2)
    assert leaked == 0, f"{leaked} of {rays} rays"


def test_trees_over_shapes_have_the_boxes_of_the_cpu_by_their_ends(tmp_path: Path) -> None:
    world = many_worlds()[0]
    g = world.geometry
    on_cpu, anchor, reach = by_ends(g.top.numpy()), g.anchor.numpy(), g.top_reach.numpy()
    these = Refit()
    these.anchor_shape = len(g.kind)
    worlds = g.top.size // g.top_count
    these.fits, these.area = wp.empty(g.top.size, dtype=Fit, device="cpu"), wp.empty(worlds, dtype=float, device="cpu")
    levels = wp.array(world._top._levels, dtype=int, device="cpu")
    g.top_reach.zero_()
    CudaSource(refit_in_blocks, tmp_path, BLOCK).launch(np.arange(worlds), [g, levels, these])
    got = g.top.numpy()
    for end in (f"{name}_{axis}" for name in ("center", "half") for axis in "xyz"):
        np.testing.assert_allclose(got[end], on_cpu[end], rtol=1e-6, atol=1e-5, err_msg=end)
    np.testing.assert_array_equal(g.anchor.numpy(), anchor)
    np.testing.assert_allclose(g.top_reach.numpy(), reach, rtol=1e-6)
