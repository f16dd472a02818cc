"""Triangle trees cached on disk, so that a second start with the same meshes does not build them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.world.arrays import TriangleTree
from rigcast.kernels.world.triangle_tree import build_triangle_tree

from .on_disk import Arrays, digest_of, kept_arrays

FEWEST_FACES = 1000
"""Least number of faces of a tree with a file of its own; building smaller ones is faster than reading them."""

_NAMES = ["nodes", "blocks", "lower", "upper", "dropped"]
_SIZES = ["node_count", "block_count"]


def cached_triangle_tree(vertices: ArrayLike, faces: ArrayLike) -> TriangleTree:
    """The tree of build_triangle_tree, read from disk if it was built before; raises the same errors."""
    v, f = np.asarray(vertices), np.asarray(faces)
    if len(f) < FEWEST_FACES:
        return build_triangle_tree(v, f)
    arrays = kept_arrays(_NAMES, digest_of((v, f)), lambda: _arrays(build_triangle_tree(v, f)))
    return TriangleTree(**{name: _plain(array) for name, array in arrays.items()})


def cached_small_trees(
    meshes: Sequence[tuple[NDArray[Any], NDArray[Any]]], build: Callable[[], list[TriangleTree]]
) -> list[TriangleTree]:
    """The trees that `build` makes of meshes with fewer faces, cached in one file for all; raises the same errors."""
    if sum(len(faces) for _, faces in meshes) < FEWEST_FACES:
        return build()
    digest = digest_of(array for mesh in meshes for array in mesh)
    return _apart(kept_arrays([*_NAMES, *_SIZES], digest, lambda: _joined(build())))


def _joined(trees: Sequence[TriangleTree]) -> Arrays:
    """The concatenated arrays of trees, and the numbers of nodes and blocks of each."""
    ends = {name: np.array([getattr(tree, name) for tree in trees]) for name in ("lower", "upper", "dropped")}
    whole = {name: np.concatenate([getattr(tree, name) for tree in trees]) for name in ("nodes", "blocks")}
    sizes = [[len(tree.nodes) for tree in trees], [len(tree.blocks) for tree in trees]]
    return ends | whole | {name: np.array(size) for name, size in zip(_SIZES, sizes, strict=True)}


def _apart(arrays: Arrays) -> list[TriangleTree]:
    """The trees from the arrays of `_joined`."""
    nodes, blocks = (
        np.split(arrays[name], np.cumsum(arrays[size])[:-1])
        for name, size in zip(("nodes", "blocks"), _SIZES, strict=True)
    )
    return [
        TriangleTree(*tree)
        for tree in zip(nodes, blocks, arrays["lower"], arrays["upper"], arrays["dropped"].tolist(), strict=True)
    ]


def _arrays(tree: TriangleTree) -> Arrays:
    return {name: np.asarray(getattr(tree, name)) for name in _NAMES}


def _plain(array: NDArray[Any]) -> Any:
    return array if array.ndim else array.item()
