"""Rays in packets have the hits of single rays, bit for bit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_rays import PATTERNS, axes, camera, lidar, sphere
from made_worlds import (
    Doubles,
    Hits,
    Mesh,
    Plan,
    assert_same,
    cube,
    field,
    grid,
    icosphere,
    random_plan,
    random_rotations,
    rays_of,
    torus,
    turned,
    unit,
)
from numpy.typing import ArrayLike

from rigcast.kernels.cast import cast
from rigcast.kernels.launching import slices
from rigcast.kernels.packets.packet import LANES, PACKETS
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.shapes import solids
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE, GRAZING
from rigcast.kernels.world.world import World


def in_packets_and_alone(
    world: World,
    origin: ArrayLike,
    directions: Doubles,
    rotation: Doubles | None = None,
    limit: float = np.inf,
    cull: int = CULL_NONE,
    visible: ArrayLike = True,
) -> tuple[Hits, Hits]:
    """The same rays, cast in packets and one by one, from an origin in the world."""
    seen = np.ascontiguousarray(np.broadcast_to(np.asarray(visible, bool), len(world.geometry.kind)))
    rays = rays_of(np.zeros(3), directions)
    pose = np.eye(3) if rotation is None else rotation
    position = wp.array(np.asarray(origin, np.float64)[None], dtype=wp.vec3d, device="cpu")
    alone = replace(rays, position=position, rotation=wp.array(pose[None], dtype=wp.mat33d, device="cpu"))
    in_packets = replace(alone, packets=sort_into_packets(directions))
    both = []
    for each in (in_packets, alone):
        hits = cast(world.geometry, wp.array(seen, dtype=wp.bool, device="cpu"), each, limit, cull)
        both.append(Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy()))
    return both[0], both[1]


@pytest.mark.parametrize("name", PATTERNS)
def test_every_ray_is_in_one_place(name: str) -> None:
    directions = PATTERNS[name]
    packets = sort_into_packets(directions)
    lanes = packets.packets.numpy()["ray"] if packets.packets.size else np.empty((0, LANES), int)
    assert len(lanes) == PACKETS * packets.tiles.size
    assert sorted([*lanes[lanes >= 0], *packets.singles.numpy()]) == list(range(len(directions)))


def test_packets_are_compact() -> None:
    """A packet of a camera covers less than 3 times the area of its pixels."""
    tiles = sort_into_packets(camera(640, 480)).tiles.numpy()
    pixel = np.tan(np.radians(30.0)) * 2 / 640
    width, height = (np.median(tiles[f"{k}_high"] - tiles[f"{k}_low"]) for k in "pq")
    assert width * height < 3 * LANES * pixel**2


@pytest.mark.parametrize(("width", "height"), [(640, 480), (75, 30)])
def test_an_image_is_cast_in_squares(width: int, height: int) -> None:
    """All but the last columns and rows, which do not fill a tile."""
    rays = sort_into_packets(camera(width, height)).packets.numpy()["ray"].reshape(-1, 4, 4)
    row, column = np.divmod(rays, width)
    are_squares = (np.diff(column, axis=2) == 1).all(axis=(1, 2)) & (np.diff(row, axis=1) == 1).all(axis=(1, 2))
    assert are_squares.sum() == PACKETS * (width // 16) * (height // 8)


def test_rows_that_are_far_apart_are_not_mixed() -> None:
    columns = 640
    rays = sort_into_packets(lidar(16, columns, 15.0)).packets.numpy()["ray"]
    assert (np.ptp(rays // columns, axis=1) == 0).all()


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("seed", range(3))
def test_random_worlds(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = random_plan(seed).world()
    for origin in (np.zeros(3), rng.uniform(-4, 4, 3), rng.uniform(-40, 40, 3)):
        got, expected = in_packets_and_alone(world, origin, PATTERNS[name], random_rotations(rng, 1)[0])
        assert_same(got, expected, f"seed {seed}, from {origin}")


@pytest.mark.parametrize("tilt", [0.0, 1e-15, 1e-9, 1e-7, 1e-6, 1e-3])
def test_rays_along_a_plane(tilt: float) -> None:
    """Some or all rays of a packet go down at a tiny angle; origins are above, on and below the plane."""
    about_y = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    plan = Plan()
    plan.add(solids.PLANE, (0, 0, 0), (0, 0, 0), about_y)
    world = plan.world()
    directions = np.concatenate([lidar(1, 1024, 0.0), lidar(64, 256, 1e-6), lidar(64, 256, 1e-3), axes(1000)])
    for height in (1.0, 1e-6, 0.0, -1.0):
        got, expected = in_packets_and_alone(world, (0, 0, height), directions)
        assert_same(got, expected, f"from {height}")
        assert np.isfinite(expected.distance).any() == (height >= 0)


@pytest.mark.parametrize("cull", [CULL_BACK, CULL_FRONT])
@pytest.mark.parametrize("limit", [2.0, np.inf])
def test_culling_limits_and_filters(cull: int, limit: float) -> None:
    plan = random_plan(5)
    visible = np.random.default_rng(5).random(len(plan.kind)) < 0.7
    world = plan.world()
    for origin in ((0, 0, 0), (1, 2, 0.5)):
        got, expected = in_packets_and_alone(world, origin, sphere(4000), None, limit, cull, visible)
        assert_same(got, expected, f"from {origin}")
        assert 0 < np.isfinite(got.distance).mean() < 1


MESHES: dict[str, Callable[[], Mesh]] = {
    "cube": cube,
    "turned cube": lambda: turned(cube(), 1),
    "grid": lambda: grid(20),
    "bumpy grid": lambda: turned(grid(20, 0.2), 2),
    "sphere": lambda: icosphere(3),
    "torus": torus,
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_rays_at_edges_and_vertices(name: str, scale: float) -> None:
    """Rays from outside and from inside a mesh, near the world's origin and far from it."""
    shape = MESHES[name]()
    corners = shape.corners.astype(np.float64)
    rng = np.random.default_rng(3)
    weights = np.concatenate([rng.dirichlet((1, 1, 1), 500), np.eye(3)[rng.integers(0, 3, 500)]])
    weights[500:750] = np.roll(np.stack([rng.random(250), np.zeros(250), np.zeros(250)], 1), 1, axis=1)
    weights[500:750, 2] = 1 - weights[500:750].sum(axis=1)
    points = scale * np.einsum("nk,nkx->nx", weights, corners[rng.integers(0, len(corners), 1000)])
    for offset in (0.0, 1e3, 1.5e5):
        plan = Plan()
        plan.add_mesh(Mesh((scale * shape.vertices).astype(np.float32), shape.faces), np.full(3, offset))
        world = plan.world()
        for start in (np.array([0.1, 0.2, 0.05]), np.array([3.0, -2.0, 4.0]), np.array([0.0, 0.0, 2.0])):
            origin = scale * start
            got, expected = in_packets_and_alone(world, origin + offset, unit(points - origin))
            assert_same(got, expected, f"offset {offset}, from {start}")
            assert np.isfinite(expected.distance).mean() > 0.2


def bumpy(name: str) -> Plan:
    """Triangles within 0.002 of the plane z = 0.5: of a mesh, or a sheet, or the top of a height field."""
    plan = Plan()
    if name == "height field":
        plan.add_tree(field(20, 20, 0.002).tree)
    else:
        plan.add_mesh(grid(20, 0.002), (0, 0, 0.5))
    plan.kind[0] = solids.SHEET if name == "sheet" else solids.TRIANGLES
    return plan


@pytest.mark.parametrize("height", [0.53, 0.47], ids=["from above", "from below"])
@pytest.mark.parametrize("name", ["mesh", "sheet", "height field"])
def test_rays_that_graze_triangles(name: str, height: float) -> None:
    """Their distances are computed in float64, in packets with other rays that do not graze."""
    y, z = np.meshgrid(np.linspace(-0.3, 0.3, 64), np.linspace(0.0, 0.06, 48) * np.sign(0.5 - height))
    directions = unit(np.stack([np.ones_like(y), y, z], axis=-1).reshape(-1, 3))
    got, expected = in_packets_and_alone(bumpy(name).world(), (-1.7, 0.1, height), directions)
    assert_same(got, expected)
    hit = expected.shape >= 0
    slopes = np.abs((expected.normal * directions).sum(axis=1))[hit]
    assert hit.mean() > 0.3
    assert 0.01 < (slopes < GRAZING).mean() < 0.99


@pytest.mark.parametrize("first", [(0, 1, 2), (2, 0, 1), (0, 2, 1)])
def test_of_two_faces_in_one_place_the_one_that_faces_the_ray_is_hit(first: tuple[int, int, int]) -> None:
    """For any order of the faces, and any first vertex of each."""
    shape = turned(grid(12, 0.2, 4), 4)
    faces = np.concatenate([shape.faces[:, first], shape.faces[:, [1, 0, 2]], shape.faces])
    plan = Plan()
    plan.add_mesh(Mesh(shape.vertices, faces), (0.3, -0.2, 0.1), random_rotations(np.random.default_rng(4), 1)[0])
    world = plan.world()
    for origin in ((3.0, 2.0, 1.5), (-3.0, -2.0, -1.5), (1e3, 2e3, -1e3)):
        directions = unit(np.random.default_rng(5).uniform(-1, 1, (2000, 3)) - origin)
        got, expected = in_packets_and_alone(world, origin, directions)
        assert_same(got, expected, f"from {origin}")
        hit = np.isfinite(got.distance)
        assert hit.mean() > 0.1
        assert ((got.normal[hit] * directions[hit]).sum(axis=1) <= 0).all()


DOUBLED: dict[str, tuple[ArrayLike, Doubles, tuple[bool, bool, bool], set[int]]] = {
    "in one place": ((0, 0, 0), np.eye(3), (True, True, True), {0}),
    "the first unseen": ((0, 0, 0), np.eye(3), (False, True, True), {1}),
    "the second unseen": ((0, 0, 0), np.eye(3), (True, False, True), {0}),
    "the second nearer": ((1e-9, 0, 0), np.eye(3), (True, True, True), {0, 1}),
    "the second turned": ((0, 0, 0), random_rotations(np.random.default_rng(0), 1)[0], (True, True, True), {0, 1}),
}


@pytest.mark.parametrize("name", DOUBLED)
def test_one_mesh_three_times(name: str) -> None:
    """Of equal meshes the first is hit; of meshes that differ by a little, the nearer one."""
    position, rotation, visible, hit = DOUBLED[name]
    plan = Plan()
    plan.add_mesh(turned(icosphere(2), 1))
    plan.add_mesh(0, position, rotation)
    plan.add_mesh(0)
    directions = unit(np.random.default_rng(6).uniform(-1, 1, (3000, 3)) - (3.0, 2.0, 1.5))
    got, expected = in_packets_and_alone(plan.world(), (3.0, 2.0, 1.5), directions, visible=visible)
    assert_same(got, expected)
    assert set(np.unique(got.shape)) - {-1} == hit


def test_a_ray_from_within_a_closed_mesh_never_escapes() -> None:
    plan = Plan()
    plan.add_mesh(turned(icosphere(4), 1))
    got, _ = in_packets_and_alone(plan.world(), (0.3, 0.1, -0.2), sphere(100_000))
    assert (got.shape == 0).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e30])
def test_a_pose_that_is_no_pose_gives_nan(bad: float) -> None:
    got, expected = in_packets_and_alone(random_plan(1).world(), (bad, 0, 0), sphere(300))
    assert_same(got, expected)
    assert np.isnan(got.distance).all()
    got, _ = in_packets_and_alone(random_plan(1).world(), (0, 0, 0), sphere(300), np.full((3, 3), np.nan))
    assert np.isnan(got.distance).all()


def test_empty_world() -> None:
    got, _ = in_packets_and_alone(Plan().world(), (0, 0, 0), sphere(300))
    assert np.isinf(got.distance).all()
    assert (got.shape == -1).all()


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
def test_threads_do_not_show(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    world = random_plan(2).world()
    expected, _ = in_packets_and_alone(world, (0, 0, 0), PATTERNS["64 beams"])
    monkeypatch.setattr(slices, "thread_count", lambda: threads)
    got, _ = in_packets_and_alone(world, (0, 0, 0), PATTERNS["64 beams"])
    assert_same(got, expected)
