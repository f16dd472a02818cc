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
from various_scenes import SCENES, Scene, every_seventh_is_hidden, many_worlds, many_worlds_that_move

from rigcast.kernels import cast
from rigcast.kernels.geometry import Geometry, Patch
from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.rays.coherent import Warps
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.kernels.single.threads import launches
from rigcast.kernels.single.threads.cast import hold
from rigcast.kernels.single.threads.hits import BLOCK as THREADS
from rigcast.kernels.single.threads.hits import complete_hits
from rigcast.kernels.single.threads.launches import InThreads
from rigcast.kernels.trees.fit import Fit
from rigcast.kernels.trees.fours import in_fours, levels_of, moved_fours
from rigcast.kernels.trees.nodes import NO_CHILD, Four, ends_of, struct_zeros
from rigcast.kernels.world.refit_in_blocks import BLOCK, copy_to_trees_of_fours, refit_in_blocks
from rigcast.kernels.world.top_level import Refit
from rigcast.kernels.world.unfolded import lead_to_nodes, nodes_of, patches_of
from rigcast.kernels.world.world import World

BLOCKS = 3
pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="no g++ to compile CUDA's source with")


@pytest.fixture(scope="module")
def source_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[wp.Kernel, int], CudaSource]:
    return cache(lambda kernel, arch: CudaSource(kernel, tmp_path_factory.mktemp(kernel.key), THREADS, arch))


@pytest.fixture
def begin_cuda(
    source_of: Callable[[wp.Kernel, int], CudaSource], monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Callable[[], None]:
    """A function after whose call single rays are cast by CUDA's source. Blocks run one after the other: the first
    casts all rays, the others find none left."""
    arch = getattr(request, "param", 900)

    def launch(source: CudaSource, geometry: Geometry, inputs: Sequence[Any]) -> None:
        as_on_cpu = geometry.root, geometry.top_count
        store_in_fours(geometry)
        source.launch(np.arange(BLOCKS), inputs)
        geometry.root, geometry.top_count = as_on_cpu

    def record(kernel: wp.Kernel, count: int, inputs: Sequence[Any], *others: Any) -> Callable[[], None]:
        if kernel is hold:
            geometry = inputs[1]
            patches = patches_of(geometry.plots.numpy(), geometry.sides.numpy())
            geometry.patches = wp.array(patches, dtype=Patch, device="cpu")
            return recorded(kernel, count, inputs, *others)
        if kernel is complete_hits:
            return lambda: source_of(kernel, arch).launch(np.arange(-(-count // THREADS)), inputs, count)
        return lambda: launch(source_of(kernel, arch), inputs[0], inputs)

    def begin() -> None:
        monkeypatch.setattr(cast, "_prepare_singles", cast._in_threads)
        monkeypatch.setattr(launches, "recorded", record)

    return begin


def store_in_fours(geometry: Geometry) -> None:
    """Store all trees as on CUDA."""
    nodes, root = geometry.nodes.numpy(), geometry.root.numpy()
    nodes = np.concatenate([lead_to_nodes(nodes, len(nodes)), nodes_of(geometry.patches.numpy())])
    if len(nodes):
        roots, own = np.unique(root, return_inverse=True)
        each = [in_fours_from(nodes, at) for at in roots]
        first = np.cumsum([0, *map(len, each)])
        geometry.fours = wp.array(np.concatenate([*map(moved_fours, each, first)]), dtype=Four, device="cpu")
        geometry.root = wp.array(first[own], dtype=int, device="cpu")
    geometry.top_fours, geometry.top_count = top_in_fours(geometry)


def top_in_fours(geometry: Geometry) -> tuple[wp.array, int]:
    """The trees over shapes as on CUDA, and the number of nodes of each; shorter ones are filled up."""
    top = geometry.top.numpy()
    each = [in_fours_from(top, first) for first in range(0, len(top), geometry.top_count)]
    most = max(map(len, each))
    filled = [np.concatenate([fours, struct_zeros(Four, most - len(fours))]) for fours in each]
    return wp.array(np.concatenate(list(map(moved_fours, filled, range(0, most * len(each), most)))), dtype=Four), most


def in_fours_from(nodes: np.ndarray, root: int) -> np.ndarray:
    """The tree with this root among nodes."""
    order = [root]
    for at in order:
        order += [child for child in nodes["child"][at] if child >= 0]
    place = np.zeros(len(nodes), np.int32)
    place[order] = np.arange(len(order))
    child = nodes["child"][order]
    return in_fours(np.where(child >= 0, place[np.maximum(child, 0)], child), *ends_of(nodes[order]))


def hits_of(world: World, rays: Rays, limit: float = np.inf, cull: int = CULL_NONE) -> Hits:
    hits = cast.cast(world.geometry, every_seventh_is_hidden(world), rays, limit, cull)
    return Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy())


def in_warps(rays: Rays) -> Rays:
    """The rays sorted into warps at random; of several worlds some warps have rays of two."""
    order = np.random.default_rng(2).permutation(rays.directions.shape[-1])
    return replace(rays, packets=Warps(wp.array(order, dtype=int, device="cpu")))


@pytest.mark.parametrize(("limit", "cull"), [(np.inf, CULL_NONE), (3.0, CULL_BACK), (np.inf, CULL_FRONT)])
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
@pytest.mark.parametrize("is_in_warps", [False, True], ids=["each_by_itself", "in_warps"])
def test_it_hits_what_single_rays_hit(
    scene: Callable[[], Scene], limit: float, cull: int, is_in_warps: bool, begin_cuda: Callable[[], None]
) -> None:
    world, rays = scene()
    expected = hits_of(world, rays, limit, cull)
    begin_cuda()
    assert_same(hits_of(world, in_warps(rays) if is_in_warps else rays, limit, cull), expected)


def test_warps_of_one_span_that_moves_hit_what_single_rays_hit(begin_cuda: Callable[[], None]) -> None:
    world, rays = many_worlds_that_move()
    expected = hits_of(world, rays)
    begin_cuda()
    assert rays.firing is not None
    order = wp.array(np.argsort(rays.firing.numpy(), kind="stable"), dtype=int, device="cpu")
    assert_same(hits_of(world, replace(rays, packets=Warps(order))), expected)


@pytest.mark.parametrize("begin_cuda", [750], indirect=True)
def test_warps_of_older_gpus_hit_what_single_rays_hit(begin_cuda: Callable[[], None]) -> None:
    world, rays = many_worlds()
    expected = hits_of(world, rays)
    begin_cuda()
    assert_same(hits_of(world, in_warps(rays)), expected)


def test_it_hits_what_packets_hit(begin_cuda: Callable[[], None]) -> None:
    directions = unit(np.random.default_rng(1).normal(size=(20_000, 3)))
    world, rays = random_plan(1).world(), rays_of((0.3, 0.2, 0.1), directions)
    expected = hits_of(world, replace(rays, packets=sort_into_packets(directions)))
    begin_cuda()
    assert_same(hits_of(world, rays), expected)


@pytest.mark.parametrize("is_in_warps", [False, True], ids=["each_by_itself", "in_warps"])
def test_sensors_read_at_once_what_each_reads_alone(is_in_warps: bool, begin_cuda: Callable[[], None]) -> None:
    begin_cuda()
    alone = [replace(rays, packets=None) for rays in several_casts.rays_of_sensors()]
    rays = [in_warps(each) if each.directions.size else each for each in alone] if is_in_warps else alone
    several_casts.check_at_once(random_plan(several_casts.SEED).world(), rays)


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


def boxes_of_shapes(fours: np.ndarray, count: int) -> dict[tuple[int, int], np.ndarray]:
    """The ends of the box of each shape in each tree of `count` nodes."""
    ends = np.stack([fours[f"{end}_{axis}"] for end in ("lower", "upper") for axis in "xyz"], axis=-1)
    child = fours["child"]
    shapes = zip(*np.nonzero((child < 0) & (child != NO_CHILD)), strict=True)
    return {(at // count, int(~child[at, j])): ends[at, j] for at, j in shapes}


def assert_boxes_enclose_what_is_below(fours: np.ndarray) -> None:
    for axis in "xyz":
        lower, upper = fours[f"lower_{axis}"], fours[f"upper_{axis}"]
        inner = np.nonzero(fours["child"] >= 0)
        below = fours["child"][inner]
        np.testing.assert_array_equal(lower[inner], lower[below].min(axis=1))
        np.testing.assert_array_equal(upper[inner], upper[below].max(axis=1))


def test_trees_over_shapes_have_the_boxes_of_the_cpu(tmp_path: Path) -> None:
    world = many_worlds()[0]
    g = world.geometry
    worlds = g.top.size // g.top_count
    on_cpu, most = top_in_fours(g)
    expected = boxes_of_shapes(on_cpu.numpy(), most)
    anchor, reach = g.anchor.numpy(), g.top_reach.numpy()
    fours = in_fours_from(g.top.numpy(), 0)
    g.top_fours, g.top_count = wp.zeros(worlds * len(fours), dtype=Four), len(fours)
    copied = CudaSource(copy_to_trees_of_fours, tmp_path / "copy", BLOCK)
    of_all = [wp.array(fours, dtype=Four, device="cpu"), g.top_fours]
    copied.launch(np.arange(-(-g.top_fours.size // BLOCK)), of_all, g.top_fours.size)
    these = Refit()
    these.anchor_shape = len(g.kind)
    these.fits = wp.empty(worlds * len(fours), dtype=Fit, device="cpu")
    these.area = wp.empty(worlds, dtype=float, device="cpu")
    g.top_reach.zero_()
    levels = wp.array(levels_of(fours), dtype=int, device="cpu")
    CudaSource(refit_in_blocks, tmp_path / "refit", BLOCK).launch(np.arange(worlds), [g, levels, these])
    made = g.top_fours.numpy()
    inner = np.nonzero(made["child"] >= 0)
    np.testing.assert_array_equal(made["child"][inner] // len(fours), inner[0] // len(fours))
    got = boxes_of_shapes(made, len(fours))
    assert got.keys() == expected.keys()
    for key, box in got.items():
        np.testing.assert_allclose(box, expected[key], rtol=1e-6, atol=1e-5, err_msg=str(key))
    assert_boxes_enclose_what_is_below(made)
    np.testing.assert_array_equal(g.anchor.numpy(), anchor)
    np.testing.assert_allclose(g.top_reach.numpy(), reach, rtol=1e-6)
