"""Triangle trees keep every face that has an area, once, with its own corners and normal."""

import numpy as np
import pytest
from made_worlds import Mesh, cube, field, grid, icosphere, mesh, torus, unit

from rigcast.kernels.geometry import NO_FACE, PATCHES
from rigcast.kernels.trees.nodes import FIRST_PLOT, NO_CHILD
from rigcast.kernels.world.arrays import TriangleTree, join_triangle_trees
from rigcast.kernels.world.triangle_tree import build_triangle_tree
from rigcast.kernels.world.unfolded import patches_of

MESHES = {
    "one triangle": mesh(np.eye(3), [(0, 1, 2)]),
    "cube": cube(),
    "icosphere": icosphere(2),
    "torus": torus(),
    "flat grid": grid(9),
}


def lanes(tree: TriangleTree) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces (n,), corners (n, 3, 3) and normals (n, 3) of the lanes that hold a triangle."""
    taken = tree.blocks["face"] != NO_FACE
    corners = [[tree.blocks[f"{axis}{k}"][taken] for axis in "xyz"] for k in range(3)]
    normal = [tree.blocks[f"normal_{axis}"][taken] for axis in "xyz"]
    return tree.blocks["face"][taken], np.moveaxis(np.array(corners), 2, 0), np.stack(normal, axis=-1)


@pytest.mark.parametrize("name", MESHES)
def test_every_face_is_in_the_tree_once_as_it_is(name: str) -> None:
    shape = MESHES[name]
    tree = build_triangle_tree(shape.vertices, shape.faces)
    face, corners, normal = lanes(tree)
    np.testing.assert_array_equal(np.sort(face), np.arange(len(shape.faces)))
    np.testing.assert_array_equal(corners, shape.corners[face])
    v = shape.corners[face].astype(np.float64)
    np.testing.assert_allclose(normal, unit(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])), atol=1e-7)
    assert tree.dropped == 0
    np.testing.assert_array_equal(tree.lower, shape.corners.min(axis=(0, 1)))
    np.testing.assert_array_equal(tree.upper, shape.corners.max(axis=(0, 1)))


def test_faces_without_area_are_dropped_and_counted_and_the_others_keep_their_number() -> None:
    good = cube()
    flat = [(0, 0, 1), (1, 1, 1), (8, 9, 10)]
    line = [(9.0, 0, 0), (9.5, 0, 0), (10.0, 0, 0)]
    shape = Mesh(
        np.concatenate([good.vertices, np.array(line, np.float32)]), np.insert(good.faces, [0, 3, 12], flat, axis=0)
    )
    tree = build_triangle_tree(shape.vertices, shape.faces)
    assert tree.dropped == 3
    face, corners, _ = lanes(tree)
    np.testing.assert_array_equal(np.sort(face), np.setdiff1d(np.arange(15), [0, 4, 14]))
    np.testing.assert_array_equal(corners, shape.corners[face])
    np.testing.assert_array_equal(tree.upper, [1, 1, 1])


def test_tiny_triangles_have_an_area() -> None:
    """At 1e-25 m, whose square underflows float32."""
    tree = build_triangle_tree(1e-25 * np.eye(3), [(0, 1, 2)])
    assert tree.dropped == 0
    np.testing.assert_allclose(lanes(tree)[2], [np.ones(3) / np.sqrt(3)], rtol=1e-6)


@pytest.mark.parametrize("faces", [np.zeros((0, 3), int), [(0, 0, 0)]], ids=["no faces", "none with an area"])
def test_mesh_with_nothing_to_hit(faces: np.ndarray) -> None:
    tree = build_triangle_tree(np.zeros((1, 3)), faces)
    assert tree.dropped == len(faces)
    assert len(tree.blocks) == 0
    assert (tree.nodes["child"] == NO_CHILD).all()
    np.testing.assert_array_equal([tree.lower, tree.upper], np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("vertex", "index", "message"),
    [
        ((0, 0, 0), 4, "face 1: got vertex 4, expected 0 to 3"),
        ((0, 0, 0), -1, "face 1: got vertex -1, expected 0 to 3"),
        ((0, np.nan, 0), 3, r"face 1: vertex 3: got \[0.0, nan, 0.0\], expected finite numbers up to 1e\+18 m"),
        ((np.inf, 0, 0), 3, r"face 1: vertex 3: got \[inf, 0.0, 0.0\], expected finite"),
        ((0, 0, -2e18), 3, r"face 1: vertex 3: got \[0.0, 0.0, -2e\+18\], expected finite"),
    ],
)
def test_bad_vertices_and_indices_are_named(vertex: tuple[float, float, float], index: int, message: str) -> None:
    vertices = np.concatenate([np.eye(3), [vertex]])
    with pytest.raises(ValueError, match=f"^{message}"):
        build_triangle_tree(vertices, [(0, 1, 2), (0, 1, index)])


def test_joined_trees_lead_to_their_own_nodes_and_blocks() -> None:
    meshes = (torus(), MESHES["one triangle"], grid(6), cube())
    trees = [build_triangle_tree(m.vertices, m.faces) for m in meshes]
    trees = [field(5, 9, 0.1).tree, *trees, field(8, 3, 0.1).tree, *trees]
    nodes, blocks, plots, sides, places = join_triangle_trees(trees)
    assert len(nodes) == sum(len(t.nodes) for t in trees)
    first_block = 0
    for tree, place in zip(trees, places, strict=True):
        root = place.node
        reached_nodes, reached_plots, reached_leaves = {root}, set(), set()
        to_visit = [root]
        while to_visit:
            child = nodes["child"][to_visit.pop()]
            inner = child[child >= 0].tolist()
            to_visit += inner
            reached_nodes |= set(inner)
            leaves = ~child[(child < 0) & (child != NO_CHILD)]
            reached_plots |= set((leaves[leaves >= FIRST_PLOT] - FIRST_PLOT).tolist())
            reached_leaves |= set(leaves[leaves < FIRST_PLOT].tolist())
        assert reached_nodes == set(range(root, root + len(tree.nodes)))
        assert reached_leaves == set(range(first_block, first_block + len(tree.blocks)))
        assert reached_plots == set(range(place.plot, place.plot + len(tree.plots)))
        np.testing.assert_array_equal(blocks["face"][first_block : first_block + len(tree.blocks)], tree.blocks["face"])
        patches = patches_of(plots[place.plot :][: len(tree.plots)], sides)
        assert patches.tobytes() == patches_of(tree.plots, tree.sides).tobytes()
        first_block += len(tree.blocks)


def test_no_trees_to_join() -> None:
    assert [len(a) for a in join_triangle_trees([])] == [0, 0, 0, 0, 0]


@pytest.mark.parametrize("most", ["blocks", "patches"])
def test_more_leaves_than_there_are_numbers_for_are_refused(most: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = field(5, 9, 0.1).tree
    monkeypatch.setattr("rigcast.kernels.world.arrays.FIRST_PATCH", max(len(tree.blocks), PATCHES * len(tree.plots)))
    join_triangle_trees([tree])
    trees = [tree, build_triangle_tree(torus().vertices, torus().faces) if most == "blocks" else tree]
    count = sum(len(one.blocks) if most == "blocks" else PATCHES * len(one.plots) for one in trees)
    with pytest.raises(ValueError, match=rf"^triangle trees: got .*{count} {most}.*, expected up to \d+ of each"):
        join_triangle_trees(trees)
