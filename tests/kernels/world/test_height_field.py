"""Height fields, whose triangles are not stored, have the hits of meshes of the same triangles."""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type"

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_worlds import (
    Doubles,
    Field,
    Mesh,
    Plan,
    assert_same,
    cast_through,
    field,
    random_rays,
    random_rotations,
    rays_of,
    unit,
)
from moeller_trumbore import dot, norm
from numpy.typing import NDArray

from rigcast.kernels.cast import cast
from rigcast.kernels.geometry import FARTHEST, Plot
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.shapes.patches import open_plot
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.kernels.trees.nodes import FIRST_PATCH, NO_CHILD, Node
from rigcast.kernels.trees.tree import STACK
from rigcast.kernels.world.arrays import TriangleTree
from rigcast.kernels.world.height_field import build_height_field
from rigcast.kernels.world.unfolded import lead_to_nodes, nodes_of, patches_of
from rigcast.kernels.world.world import World

FIELDS = {
    f"{rows} x {columns}, up to {bumps:g} m": field(rows, columns, bumps, seed)
    for seed, (rows, columns, bumps) in enumerate(
        [
            (2, 2, 0.3),
            (2, 3, 0.3),
            (3, 2, 0.3),
            (3, 3, 0.3),
            (4, 4, 0.0),
            (5, 8, 0.3),
            (2, 40, 0.1),
            (61, 2, 0.1),
            (30, 31, 0.1),
            (33, 20, 20.0),
            (65, 65, 0.0),
        ]
    )
}
RAYS = 20_000


@pytest.fixture(autouse=True, params=[0, 2**14], ids=["plots are opened", "plots are stored as nodes"])
def most_stored(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigcast.kernels.world.stored_trees.MOST_STORED", request.param)


EPS = 2.0**-23


def within(shape: Mesh) -> Doubles:
    """Corners (n, 3, 3) of the faces of a surface that do not touch its border."""
    return shape.corners[(np.abs(shape.corners[..., :2]) < (0.999, 1.499)).all(axis=(1, 2))].astype(float)


def through(name: str, count: int, seed: int) -> tuple[Doubles, Doubles]:
    """Origins and unit directions of rays from all around to points on triangles of a field."""
    shape, rng = FIELDS[name].mesh, np.random.default_rng(seed)
    weights = rng.dirichlet((1, 1, 1), count)
    targets = np.einsum("rk,rkx->rx", weights, shape.corners[rng.integers(0, len(shape.faces), count)].astype(float))
    away = unit(rng.normal(size=(count, 3))) * 10 ** rng.uniform(-1, 1, (count, 1))
    return targets + away, unit(-away)


@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT])
@pytest.mark.parametrize("name", FIELDS)
def test_it_is_hit_as_a_mesh_of_its_triangles_is(name: str, cull: int) -> None:
    position, rotation = (3.0, -2.0, 1.0), random_rotations(np.random.default_rng(1), 1)[0]
    origins, directions = through(name, RAYS, seed=2)
    found = []
    for is_tree in (True, False):
        plan = Plan()
        if is_tree:
            plan.add_tree(FIELDS[name].tree, position, rotation)
        else:
            plan.add_mesh(FIELDS[name].mesh, position, rotation)
        found.append(cast_through(plan.world(), origins @ rotation.T + position, directions @ rotation.T, cull=cull))
    got, expected = found
    np.testing.assert_array_equal(got.face, expected.face)
    hit = got.face >= 0
    assert hit.mean() > 0.5
    t, normal = expected.distance[hit].astype(float), expected.normal[hit].astype(float)
    reach = norm(FIELDS[name].mesh.corners[got.face[hit]] - origins[hit, None]).max(axis=1)
    # each is within 3 eps (max |Vi - O| + t) / |cos| of what it should be
    bound = 6 * EPS * (reach + t) / np.abs(dot(directions[hit] @ rotation.T, normal))
    assert (np.abs(got.distance[hit] - t) <= bound).all()
    np.testing.assert_allclose(got.normal, expected.normal, atol=2e-7)


@pytest.mark.parametrize("name", FIELDS)
def test_every_face_is_hit_where_it_is(name: str) -> None:
    """A ray along the normal of each face, at its middle, hits that face number."""
    shape = FIELDS[name].mesh
    corners = shape.corners.astype(float)
    normal = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    plan = Plan()
    plan.add_tree(FIELDS[name].tree)
    got = cast_through(plan.world(), corners.mean(axis=1) + 1e-3 * normal, -normal)
    np.testing.assert_array_equal(got.face, np.arange(len(corners)))
    np.testing.assert_allclose(got.distance, 1e-3, atol=1e-5)
    np.testing.assert_allclose(got.normal, normal, atol=1e-6)


@pytest.mark.parametrize("offset", [0.0, 1e5])
@pytest.mark.parametrize("name", [name for name, shape in FIELDS.items() if len(within(shape.mesh))])
def test_no_ray_goes_through_the_surface(name: str, offset: float) -> None:
    """From above, aimed exactly at corners and edges of cells, within patches and between them."""
    inner, rng = within(FIELDS[name].mesh), np.random.default_rng(3)
    face, k = rng.integers(0, len(inner), RAYS), rng.integers(0, 3, RAYS)
    a, b = inner[face, k], inner[face, (k + 1) % 3]
    targets = a + rng.choice([0.0, 0.5, rng.random()], (RAYS, 1)) * (b - a)
    # steep enough to see all faces from above, straight down or nearly
    normal = unit(np.cross(inner[:, 1] - inner[:, 0], inner[:, 2] - inner[:, 0]))
    steepest = max(3.0, (1 / normal[:, 2]).max())
    beside = 3 / steepest * rng.choice([0.0, 1.0], (RAYS, 1)) * rng.normal(size=(RAYS, 3))
    origins = targets * (1, 1, 0) + (0, 0, 30) + beside
    position = offset * np.array([1.0, -0.7, 0.3])
    plan = Plan()
    plan.add_tree(FIELDS[name].tree, position)
    got = cast_through(plan.world(), origins + position, unit(targets - origins))
    expected = norm(targets - origins)
    leaks = np.flatnonzero(~(got.distance <= expected * (1 + 3e-6 * steepest)))
    assert not leaks.size, f"{leaks.size} of {RAYS} rays, first {leaks[0]}: got {got.distance[leaks[0]]}"


def all_nodes(tree: TriangleTree) -> NDArray[np.void]:
    """The nodes of a tree, followed by the nodes of its plots."""
    return np.concatenate([lead_to_nodes(tree.nodes, len(tree.nodes)), nodes_of(patches_of(tree.plots, tree.sides))])


@wp.kernel
def open_one(plots: wp.array[Plot], sides: wp.array[float], k: int, node: wp.array[Node]) -> None:
    open_plot(plots, sides, k, node)


@pytest.mark.parametrize("name", FIELDS)
def test_plots_are_opened_as_the_nodes_that_cuda_stores(name: str) -> None:
    tree = FIELDS[name].tree
    plots = wp.array(tree.plots, dtype=Plot, device="cpu")
    sides, opened = wp.array(tree.sides, dtype=float, device="cpu"), wp.empty(1, dtype=Node, device="cpu")
    for k, expected in enumerate(nodes_of(patches_of(tree.plots, tree.sides))):
        wp.launch(open_one, 1, inputs=[plots, sides, k, opened], device="cpu")
        got, is_there = opened.numpy()[0], expected["child"] != NO_CHILD
        for part in got.dtype.names:
            np.testing.assert_array_equal(got[part][is_there], expected[part][is_there], err_msg=f"plot {k}, {part}")
        np.testing.assert_array_equal((got["half_x"] >= 0) & (got["half_y"] >= 0), is_there)


@pytest.mark.parametrize("name", FIELDS)
def test_its_tree_reaches_every_leaf_once_within_boxes_and_a_stack(name: str) -> None:
    tree = FIELDS[name].tree
    leaves: list[int] = []
    room = {0: 1}
    for k, node in enumerate(all_nodes(tree)):
        children = node["child"][node["child"] != NO_CHILD].tolist()
        full = room.pop(k) - 1 + len(children)
        assert full <= STACK
        assert all(child < 0 or child > k for child in children)
        leaves += [~child for child in children if child < 0]
        room |= dict.fromkeys((child for child in children if child >= 0), full)
    assert not room
    patches = patches_of(tree.plots, tree.sides)
    is_there = np.isfinite(patches["x"][:, 1]) & np.isfinite(patches["y"][:, 1])
    assert sorted(leaves) == [*range(len(tree.blocks)), *(FIRST_PATCH + np.flatnonzero(is_there))]


@pytest.mark.parametrize("name", FIELDS)
def test_its_boxes_hold_all_triangles_below_them(name: str) -> None:
    tree = FIELDS[name].tree
    below: dict[int, NDArray[np.float32]] = {}
    for k, node in reversed([*enumerate(all_nodes(tree))]):
        parts = []
        for j in np.flatnonzero(node["child"] != NO_CHILD):
            child = int(node["child"][j])
            parts.append(_corners(FIELDS[name], child) if child < 0 else below.pop(child))
            center, half = (np.array([node[f"{what}_{a}"][j] for a in "xyz"], float) for what in ("center", "half"))
            assert (np.abs(parts[-1] - center) <= half).all(), f"node {k}, child {j}"
        below[k] = np.concatenate(parts)


def _corners(shape: Field, child: int) -> NDArray[np.float32]:
    """Corners (n, 3) of the triangles in a leaf."""
    if ~child < FIRST_PATCH:
        block = shape.tree.blocks[~child]
        corners = np.array([[block[f"{axis}{k}"] for axis in "xyz"] for k in range(3)]).swapaxes(1, 2).reshape(-1, 3)
    else:
        patch = patches_of(shape.tree.plots, shape.tree.sides)[~child - FIRST_PATCH]
        corners = np.stack([*np.meshgrid(patch["x"], patch["y"]), patch["z"]], axis=-1).reshape(-1, 3)
    return np.asarray(corners[np.isfinite(corners).all(axis=1)])


@pytest.mark.parametrize(
    ("height", "x"), [(np.nan, 1.0), (np.inf, 1.0), (-2 * FARTHEST, 1.0), (1e39, 1.0), (0.0, np.nan)]
)
def test_what_is_not_finite_or_too_large_is_named(height: float, x: float) -> None:
    heights = np.zeros((3, 4))
    heights[1, 2] = height
    where = "row 0, column 3" if np.isnan(x) else "row 1, column 2"
    with pytest.raises(ValueError, match=rf"^{where}: got \[.*\], expected finite numbers up to 1e\+18 m"):
        build_height_field([0, 0.3, 0.6, x], [0, 1, 2], heights, [np.zeros((1, 3, 3))])


def test_triangles_without_area_are_never_hit() -> None:
    """Walls of a field whose border is at 0."""
    x, y = np.linspace(-1, 1, 5), np.linspace(-1, 1, 4)
    wall = np.zeros((8, 3, 3))
    wall[:, :, 0] = np.linspace(-1, 1, 24).reshape(8, 3)
    plan = Plan()
    plan.add_tree(build_height_field(x, y, np.zeros((4, 5)), [wall]))
    origins = np.stack([np.linspace(-0.99, 0.99, 500), np.zeros(500), np.ones(500)], axis=-1)
    got = cast_through(plan.world(), origins, (0, 0, -1))
    assert ((got.face >= 0) & (got.face < 2 * 3 * 4)).all()
    assert (got.distance == 1).all()


@pytest.mark.parametrize("packets", [False, True], ids=["alone", "in packets"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e19])
@pytest.mark.parametrize("part", ["position", "rotation"])
def test_a_field_that_is_nowhere_at_one_end_of_a_span_is_not_hit(part: str, bad: float, packets: bool) -> None:
    """Large fields are cast apart from the tree over shapes, which leaves out shapes without a finite pose."""
    plan = Plan()
    plan.add_tree(FIELDS["30 x 31, up to 0.1 m"].tree)
    poses = [np.array([each, each]) for each in plan.poses()]
    poses[part == "rotation"][1, 0, 0] = bad
    world = World(plan.trees, plan.shapes, "cpu")
    world.sweep(*poses)
    directions = unit(np.random.default_rng(0).normal(size=(500, 3)))
    for fraction in (0.0, 0.5, 1.0):
        rays = replace(
            rays_of((0, 0, 2), directions),
            packets=sort_into_packets(directions) if packets else None,
            fraction=wp.array([fraction], dtype=wp.float64, device="cpu"),
        )
        hits = cast(world.geometry, wp.array([True], dtype=wp.bool, device="cpu"), rays, np.inf, CULL_NONE)
        np.testing.assert_array_equal(hits.distance.numpy(), np.inf, err_msg=f"at {fraction}")


def test_a_field_of_other_cells_in_as_many_plots_has_its_own_faces() -> None:
    before, after = field(9, 17, 0.3), field(8, 16, 0.3)
    rng = np.random.default_rng(0)
    origins, plan = rng.uniform((-1, -1.5, 5), (1, 1.5, 5), (1000, 3)), Plan()
    plan.add_tree(before.tree)
    world = plan.world()
    world.set_tree(0, after.tree)
    got = cast_through(world, origins, (0, 0, -1))
    plan.trees = [after.tree]
    assert_same(got, cast_through(plan.world(), origins, (0, 0, -1)))


def test_a_field_that_no_shape_has_is_not_hit() -> None:
    plan = Plan()
    plan.add_tree(field(5, 8, 0.3).tree)
    world = World(plan.trees, Plan().shapes, "cpu")
    world.update(*Plan().poses())
    got = cast_through(world, *random_rays(1, 100))
    assert (got.shape == -1).all()
