"""Storage of triangle trees for casts on CUDA: concatenated in the arrays of a geometry, in nodes of four children.

Height fields are stored as patches, with nodes over them.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import PATCHES, Geometry, Patch, TriangleBlock
from rigcast.kernels.trees.fours import in_fours, moved_fours
from rigcast.kernels.trees.nodes import Four, ends_of, moved_nodes, struct_zeros

from .arrays import TreePlace, TriangleTree, joined_blocks, places_of
from .unfolded import lead_to_nodes, nodes_of, patches_of


class StoredFours:
    """The triangle trees of a geometry. trees: as given."""

    have_nodes_of_plots = True

    def __init__(self, geometry: Geometry, trees: Sequence[TriangleTree], device: wp.Device) -> None:
        self.trees = list(trees)
        self._geometry, self._device = geometry, device
        self._join()

    @property
    def roots(self) -> list[int]:
        """Index of each tree's root."""
        return self._first[:-1]

    def take(self, index: int, tree: TriangleTree) -> bool:
        """Replace a tree. Returns whether all roots and the other trees stayed in place."""
        old, self.trees[index] = self.trees[index], tree
        sizes = [(len(each.blocks), len(each.plots), each.columns) for each in (old, tree)]
        if sizes[0] == sizes[1]:
            place, first = self._places[index], self._first[index]
            patches = patches_in(tree)
            fours = fours_of(tree, place, patches)
            if len(fours) <= self._first[index + 1] - first:
                self._write(self._geometry.fours, moved_fours(fours, first), first)
                self._write(self._geometry.blocks, tree.blocks, place.block)
                self._write(self._geometry.patches, patches, PATCHES * place.plot)
                return True
        self._join()
        return False

    def _join(self) -> None:
        g, device = self._geometry, self._device
        self._places = places_of(self.trees)
        patches = [patches_in(tree) for tree in self.trees]
        each = [fours_of(*of_tree) for of_tree in zip(self.trees, self._places, patches, strict=True)]
        room = [max(len(fours), room_for(tree)) for fours, tree in zip(each, self.trees, strict=True)]
        self._first: list[int] = [0, *np.cumsum(room).tolist()]
        fours = struct_zeros(Four, self._first[-1])
        for own, first in zip(each, self.roots, strict=True):
            fours[first : first + len(own)] = moved_fours(own, first)
        g.fours = wp.array(fours, dtype=Four, device=device)
        g.patches = wp.array(np.concatenate([struct_zeros(Patch, 0), *patches]), dtype=Patch, device=device)
        g.blocks = wp.array(joined_blocks(self.trees), dtype=TriangleBlock, device=device)

    def _write(self, array: wp.array, values: npt.NDArray[np.void], first: int) -> None:
        """Overwrite entries of an array from the first on."""
        if len(values):
            wp.copy(array, wp.array(values, dtype=array.dtype, device=self._device), dest_offset=first)


def room_for(tree: TriangleTree) -> int:
    """Nodes that are kept for a tree, so that it nearly always fits in its place when its shape changes.

    Nodes have four children, except those over two or three leaves, which makes two nodes for three leaves at most; and
    except those that keep a traversal's stack short, which are rare.
    """
    return max(1, 2 * (len(tree.blocks) + PATCHES * len(tree.plots)) // 3)


def patches_in(tree: TriangleTree) -> npt.NDArray[np.void]:
    """The patches of a height field."""
    return patches_of(tree.plots, tree.sides, tree.first_side)


def fours_of(tree: TriangleTree, place: TreePlace, patches: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The nodes of a tree, its root being node 0, over its blocks and patches at a place in joined arrays."""
    nodes = lead_to_nodes(moved_nodes(tree.nodes, 0, place.block), len(tree.nodes))
    nodes = np.concatenate([nodes, nodes_of(patches, PATCHES * place.plot)])
    return in_fours(nodes["child"], *ends_of(nodes))
