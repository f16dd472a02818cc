"""Triangle trees stored for CUDA, here in the CPU's memory: after one is replaced, each is as if it was alone."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from made_worlds import field, grid, icosphere, torus

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.trees.nodes import FIRST_PATCH, NO_CHILD
from rigcast.kernels.world import stored_fours
from rigcast.kernels.world.arrays import TriangleTree
from rigcast.kernels.world.deform import DeformingTree
from rigcast.kernels.world.stored_fours import StoredFours
from rigcast.kernels.world.triangle_tree import build_triangle_tree


def stored(trees: list[TriangleTree]) -> tuple[StoredFours, Any]:
    geometry = Geometry()
    return StoredFours(geometry, trees, wp.get_device("cpu")), geometry


def parts_below(geometry: Any, root: int) -> list[bytes]:
    """The boxes of all children below a root, and the triangles of those that are leaves, as walked from the root."""
    fours, blocks, patches = (getattr(geometry, name).numpy() for name in ("fours", "blocks", "patches"))
    parts, order = [], [root]
    for at in order:
        node = fours[at]
        for j in np.flatnonzero(node["child"] != NO_CHILD):
            parts += [node[f"{end}_{axis}"][j].tobytes() for end in ("lower", "upper") for axis in "xyz"]
            child = int(node["child"][j])
            if child >= 0:
                order.append(child)
            else:
                leaf = ~child
                parts.append((patches[leaf - FIRST_PATCH] if leaf >= FIRST_PATCH else blocks[leaf]).tobytes())
    return parts


def assert_each_is_as_if_alone(trees: StoredFours, geometry: Any) -> None:
    for k, (root, tree) in enumerate(zip(trees.roots, trees.trees, strict=True)):
        _, alone = stored([tree])
        assert parts_below(geometry, root) == parts_below(alone, 0), f"tree {k}"


def mesh_trees() -> tuple[TriangleTree, TriangleTree]:
    """A mesh at rest, and bent without losing its topology."""
    mesh = grid(20)
    deforming = DeformingTree(mesh.vertices, mesh.faces)
    at_rest = deforming.tree
    bent = mesh.vertices + 0.01 * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    return at_rest, deforming.move(bent)


def other_trees() -> list[TriangleTree]:
    return [build_triangle_tree(mesh.vertices, mesh.faces) for mesh in (icosphere(2), torus())]


REPLACED = {
    "a bent mesh": (*mesh_trees(), True),
    "heights": (field(30, 31, 0.1, seed=0).tree, field(30, 31, 0.1, seed=1).tree, True),
    "a mesh of other size": (mesh_trees()[0], other_trees()[0], False),
    "a field of other size": (field(30, 31, 0.1).tree, field(9, 10, 0.1).tree, False),
    "a mesh by nothing": (mesh_trees()[0], build_triangle_tree(np.zeros((0, 3)), np.zeros((0, 3), int)), False),
}


@pytest.mark.parametrize("name", REPLACED)
def test_a_replaced_tree_and_the_others_are_as_each_is_alone(name: str) -> None:
    old, new, stays = REPLACED[name]
    ball, ring = other_trees()
    trees, geometry = stored([old, ball, old, ring])
    roots = trees.roots
    assert trees.take(2, new) is stays
    assert (trees.roots == roots) is stays
    assert trees.trees[2] is new
    assert_each_is_as_if_alone(trees, geometry)


def test_a_tree_without_room_is_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stored_fours, "room_for", lambda _tree: 1)
    mesh, rng, stays = grid(20), np.random.default_rng(0), set[bool]()
    deforming = DeformingTree(mesh.vertices, mesh.faces)
    trees, geometry = stored([deforming.tree, other_trees()[1]])
    for _ in range(8):
        bent = mesh.vertices + 0.01 * rng.normal(size=mesh.vertices.shape)
        stays.add(trees.take(0, deforming.move(bent)))
        assert_each_is_as_if_alone(trees, geometry)
    assert stays == {False, True}


def test_no_trees_are_stored_in_empty_arrays() -> None:
    trees, geometry = stored([])
    assert trees.roots == []
    assert (geometry.fours.size, geometry.blocks.size, geometry.patches.size) == (0, 0, 0)
