"""Deforming trees have the hits of trees built anew, and are rebuilt when their boxes have become loose."""

import numpy as np
import pytest
from made_worlds import Doubles, Hits, Mesh, Plan, cast_through, grid, icosphere, random_rays, torus

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.world.arrays import TriangleTree
from rigcast.kernels.world.deform import DeformingTree
from rigcast.kernels.world.world import World

RAYS = 4000
MESHES = {"cloth": grid(20), "ball": icosphere(3), "ring": torus(), "one face": grid(1)}


def cast_at(tree: TriangleTree, **how: object) -> Hits:
    plan = Plan()
    plan.add_mesh(grid(1))
    plan.trees[0] = tree
    plan.center[0], plan.half[0] = (tree.lower + tree.upper) / 2, (tree.upper - tree.lower) / 2 * (1 + 1e-6)
    world: World = plan.world()
    return cast_through(world, *random_rays(1, RAYS, spread=2.0), **how)  # type: ignore[arg-type]


def cast_anew(vertices: Doubles, mesh: Mesh) -> Hits:
    plan = Plan()
    plan.add_mesh(Mesh(vertices.astype(np.float32), mesh.faces))
    return cast_through(plan.world(), *random_rays(1, RAYS, spread=2.0))


def waved(mesh: Mesh, k: int) -> Doubles:
    """The mesh after k steps of a wave that runs through it."""
    v = mesh.vertices.astype(np.float64)
    return v + 0.1 * k * np.sin(3 * np.roll(v, 1, axis=1) + k) + 0.3 * k


@pytest.mark.parametrize("name", MESHES)
def test_moved_tree_is_hit_as_one_built_anew(name: str) -> None:
    mesh = MESHES[name]
    tree = DeformingTree(mesh.vertices, mesh.faces)
    some = 0
    for k in range(6):
        vertices = waved(mesh, k)
        got, expected = cast_at(tree.move(vertices)), cast_anew(vertices, mesh)
        np.testing.assert_array_equal(got.distance, expected.distance, err_msg=f"step {k}")
        same = got.face == expected.face  # the tree's order decides between faces at equal distance
        assert (~same).mean() < 0.01, f"step {k}: {np.flatnonzero(~same)}"
        np.testing.assert_array_equal(got.normal[same], expected.normal[same], err_msg=f"step {k}")
        some += int((got.face >= 0).sum())
    assert some > 100


def test_tree_keeps_its_structure_for_small_moves_and_is_built_anew_when_its_boxes_have_grown() -> None:
    mesh = grid(20)
    moving = DeformingTree(mesh.vertices, mesh.faces)
    before = moving.tree.blocks["face"].copy()
    bent = mesh.vertices + 0.01 * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    np.testing.assert_array_equal(moving.move(bent).blocks["face"], before)
    shuffled = np.random.default_rng(0).permutation(mesh.vertices)
    after = moving.move(shuffled).blocks["face"]
    assert after.shape != before.shape or (after != before).any()


def test_faces_without_area_are_not_hit_until_they_have_some() -> None:
    mesh = grid(8)
    tree = DeformingTree(np.zeros_like(mesh.vertices), mesh.faces)
    assert (cast_at(tree.tree).face == -1).all()
    opened = cast_at(tree.move(mesh.vertices))
    np.testing.assert_array_equal(opened.distance, cast_anew(mesh.vertices.astype(np.float64), mesh).distance)
    folded = mesh.vertices * np.array([1, 0, 1], np.float32)
    assert (cast_at(tree.move(folded)).face == -1).all()


def test_tree_of_no_faces_is_not_hit() -> None:
    tree = DeformingTree(np.zeros((3, 3)), np.zeros((0, 3), int))
    assert (cast_at(tree.move(np.ones((3, 3)))).face == -1).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 2 * float(FARTHEST)])
def test_vertex_that_cannot_be_is_refused_and_the_tree_stays_as_it_was(bad: float) -> None:
    mesh = icosphere(2)
    tree = DeformingTree(mesh.vertices, mesh.faces)
    before = tree.tree.blocks.copy()
    vertices = mesh.vertices.copy()
    vertices[7, 1] = bad
    with pytest.raises(ValueError, match=r"vertex 7: got .* expected finite numbers up to 1e\+18 m"):
        tree.move(vertices)
    for name in ("x0", "y1", "z2", "normal_x", "face"):
        np.testing.assert_array_equal(tree.tree.blocks[name], before[name])


@pytest.mark.parametrize("corner", [-1, 3])
def test_face_of_a_vertex_that_is_not_there_is_refused(corner: int) -> None:
    with pytest.raises(ValueError, match=f"face 1: got vertex {corner}, expected 0 to 2"):
        DeformingTree(np.eye(3), [[0, 1, 2], [0, corner, 1]])
