"""Triangle trees and shapes as numpy arrays, from which a World is made."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rigcast.kernels.geometry import PATCHES, Plot, TriangleBlock
from rigcast.kernels.trees.nodes import FIRST_PATCH, Node, moved_nodes, struct_zeros


@dataclass(frozen=True)
class TriangleTree:
    """A tree over triangles, in the frame of its vertices. Child ~k of a node is block k, ~(FIRST_PLOT + k) is plot k.

    lower, upper: (3,) ends of the tree's box [m]. dropped: number of faces without area, which were left out. plots,
    sides, columns: of a height field, see Geometry.
    """

    nodes: npt.NDArray[np.void]
    blocks: npt.NDArray[np.void]
    lower: npt.NDArray[np.float32]
    upper: npt.NDArray[np.float32]
    dropped: int
    plots: npt.NDArray[np.void] = field(default_factory=lambda: struct_zeros(Plot, 0))
    sides: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    columns: int = 0
    first_side: int = 0  # index that plots use for sides[0]


class TreePlace(NamedTuple):
    """Index of a tree's first node, block, plot and side in joined arrays."""

    node: int
    block: int
    plot: int
    side: int


class JoinedTrees(NamedTuple):
    """The concatenated arrays of several trees, and the place of each tree in them."""

    nodes: npt.NDArray[np.void]
    blocks: npt.NDArray[np.void]
    plots: npt.NDArray[np.void]
    sides: npt.NDArray[np.float32]
    places: list[TreePlace]


def join_triangle_trees(trees: Sequence[TriangleTree]) -> JoinedTrees:
    """Concatenate the arrays of trees. Raises ValueError as `places_of` does."""
    places = places_of(trees)
    moved = [moved_tree(tree, place) for tree, place in zip(trees, places, strict=True)]
    return JoinedTrees(
        np.concatenate([struct_zeros(Node, 0), *(tree.nodes for tree in moved)]),
        joined_blocks(trees),
        np.concatenate([struct_zeros(Plot, 0), *(tree.plots for tree in moved)]),
        np.concatenate([np.zeros(0, np.float32), *(tree.sides for tree in moved)]),
        places,
    )


def places_of(trees: Sequence[TriangleTree]) -> list[TreePlace]:
    """The place of each tree in joined arrays.

    Raises ValueError for more than FIRST_PATCH blocks or patches.
    """
    sizes = np.array([tree_sizes(tree) for tree in trees]).reshape(-1, 4)
    _, blocks, plots, _ = sizes.sum(axis=0)
    if max(blocks, PATCHES * plots) > FIRST_PATCH:
        got = f"{blocks} blocks of stored triangles and {PATCHES * plots} patches of height fields"
        raise ValueError(f"triangle trees: got {got}, expected up to {FIRST_PATCH} of each")
    return [TreePlace(*place) for place in (np.cumsum(sizes, axis=0) - sizes).tolist()]


def joined_blocks(trees: Sequence[TriangleTree]) -> npt.NDArray[np.void]:
    """The blocks of all trees."""
    return np.concatenate([struct_zeros(TriangleBlock, 0), *(tree.blocks for tree in trees)])


def tree_sizes(tree: TriangleTree) -> TreePlace:
    """Numbers of entries of a tree in joined arrays."""
    return TreePlace(len(tree.nodes), len(tree.blocks), len(tree.plots), len(tree.sides))


def moved_tree(tree: TriangleTree, place: TreePlace) -> TriangleTree:
    """The tree with its indices shifted to a place in joined arrays."""
    plots = tree.plots.copy()
    plots["x"] += place.side - tree.first_side
    plots["y"] += place.side - tree.first_side
    nodes = moved_nodes(tree.nodes, place.node, place.block, place.plot)
    return replace(tree, nodes=nodes, plots=plots, first_side=place.side)


def boxes_of(trees: Sequence[TriangleTree]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Centre and half size (n, 3) [m] of the box around each tree's triangles."""
    lower, upper = (
        np.array([getattr(tree, side) for tree in trees], np.float32).reshape(-1, 3) for side in ("lower", "upper")
    )
    center = 0.5 * lower + 0.5 * upper
    # more than the rounding of the differences
    return center, np.maximum(upper - center, center - lower) * np.float32(1 + 1e-6)


@dataclass(frozen=True)
class Shapes:
    """Shapes as numpy arrays: kind and size as in rigcast.kernels.shapes.solids, and boxes in their own frames.

    tree: index of the triangle tree, -1 for closed forms. center, half: (n, 3) [m], half +inf where unbounded.
    """

    kind: npt.NDArray[np.int32]
    size: npt.NDArray[np.float32]
    tree: npt.NDArray[np.int32]
    center: npt.NDArray[np.float32]
    half: npt.NDArray[np.float32]

    @property
    def reach(self) -> npt.NDArray[np.float32]:
        """(n,) largest |coordinate| in the shape's own frame."""
        return np.max(np.abs(self.center) + self.half, axis=1, initial=0.0).astype(np.float32)

    @staticmethod
    def of_trees(kind: Sequence[int], tree: Sequence[int], trees: Sequence[TriangleTree]) -> "Shapes":
        """Shapes of these kinds, TRIANGLES or SHEET; tree: index of each shape's tree."""
        index = np.array(tree, np.int32)
        center, half = (ends[index] for ends in boxes_of(trees))
        return Shapes(np.array(kind, np.int32), np.zeros_like(center), index, center, half)

    @staticmethod
    def joined(parts: "Sequence[Shapes]", first_tree: npt.NDArray[np.int_]) -> "Shapes":
        """The shapes of all parts; tree indices of part k are shifted by first_tree[k]."""
        tree = [np.where(p.tree >= 0, p.tree + first, -1) for p, first in zip(parts, first_tree, strict=True)]
        return Shapes(
            np.concatenate([p.kind for p in parts]),
            np.concatenate([p.size for p in parts]),
            np.concatenate(tree).astype(np.int32),
            np.concatenate([p.center for p in parts]),
            np.concatenate([p.half for p in parts]),
        )
