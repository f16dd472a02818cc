"""Storage of triangle trees for casts on the CPU: concatenated in the arrays of a geometry."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import PATCHES, Geometry, Plot, TriangleBlock
from rigcast.kernels.launching.stack import CACHE_LINE
from rigcast.kernels.trees.nodes import Node

from .arrays import TriangleTree, join_triangle_trees, moved_tree, tree_sizes
from .unfolded import lead_to_nodes, nodes_of, patches_of

MOST_STORED = 2**14
"""Most plots that are stored as nodes, too: these nodes fit a cache and need not be made during casts."""


class StoredTrees:
    """The triangle trees of a geometry. trees: as given, but they share the geometry's arrays of triangles."""

    def __init__(self, geometry: Geometry, trees: Sequence[TriangleTree]) -> None:
        self.trees = list(trees)
        self._geometry = geometry
        self._join()

    @property
    def roots(self) -> list[int]:
        """Node index of each tree's root."""
        return [place.node for place in self._places]

    @property
    def have_nodes_of_plots(self) -> bool:
        """Whether plots of height fields are stored as nodes."""
        return self._first_plot is not None

    def take(self, index: int, tree: TriangleTree) -> bool:
        """Replace a tree. Returns whether all roots and the other trees stayed in place."""
        old, self.trees[index] = self.trees[index], tree
        fits = tree_sizes(old) == tree_sizes(tree) and old.columns == tree.columns
        if fits:
            self._overwrite(index)
        else:
            self._join()
        return fits

    def _join(self) -> None:
        g = self._geometry
        nodes, blocks, plots, sides, self._places = join_triangle_trees(self.trees)
        plots = _on_cache_lines(plots)
        g.blocks = wp.array(blocks, dtype=TriangleBlock, device="cpu", copy=False)
        g.plots = wp.array(plots, dtype=Plot, device="cpu", copy=False)
        g.sides = wp.array(sides, dtype=float, device="cpu", copy=False)
        self._first_plot: int | None = None  # index of the first node that is a plot
        if len(plots) <= MOST_STORED:
            self._first_plot = len(nodes)
            nodes = np.concatenate([lead_to_nodes(nodes, len(nodes)), nodes_of(patches_of(plots, sides))])
        g.nodes = wp.array(nodes, dtype=Node, device="cpu", copy=False)
        # self.trees share these arrays, so that triangles are kept once
        self.trees = [
            replace(
                tree,
                blocks=blocks[place.block : place.block + len(tree.blocks)],
                plots=plots[place.plot : place.plot + len(tree.plots)],
                sides=sides[place.side : place.side + len(tree.sides)],
                first_side=place.side,
            )
            for tree, place in zip(self.trees, self._places, strict=True)
        ]

    def _overwrite(self, index: int) -> None:
        place, g = self._places[index], self._geometry
        tree = moved_tree(self.trees[index], place)
        nodes = tree.nodes if self._first_plot is None else lead_to_nodes(tree.nodes, self._first_plot)
        wp.copy(g.nodes, wp.array(nodes, dtype=Node, device="cpu", copy=False), dest_offset=place.node)
        wp.copy(g.blocks, wp.array(tree.blocks, dtype=TriangleBlock, device="cpu"), dest_offset=place.block)
        if not len(tree.plots):
            return
        wp.copy(g.plots, wp.array(tree.plots, dtype=Plot, device="cpu"), dest_offset=place.plot)
        wp.copy(g.sides, wp.array(tree.sides, dtype=float, device="cpu"), dest_offset=place.side)
        if self._first_plot is not None:
            nodes = nodes_of(patches_of(tree.plots, tree.sides, tree.first_side), PATCHES * place.plot)
            wp.copy(g.nodes, wp.array(nodes, dtype=Node, device="cpu"), dest_offset=self._first_plot + place.plot)


def _on_cache_lines(values: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """A copy that begins on a cache line. It is in memory of numpy, which asks Linux for huge pages; Warp does not."""
    room = np.empty(values.nbytes + CACHE_LINE, np.uint8)
    first = -room.ctypes.data % CACHE_LINE
    copy = room[first : first + values.nbytes].view(values.dtype)
    copy[...] = values
    return copy
