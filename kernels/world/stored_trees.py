"""Storage of triangle trees for casts: concatenated in the arrays of a geometry, on its device."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import PATCHES, Geometry, Patch, Plot, TriangleBlock
from rigcast.kernels.launching.stack import CACHE_LINE
from rigcast.kernels.trees.nodes import Node, by_ends

from .arrays import TriangleTree, join_triangle_trees, moved_tree, tree_sizes
from .unfolded import lead_to_nodes, nodes_of, patches_of

MOST_STORED = 2**14
"""Most plots that are stored as nodes on a CPU, too: these nodes fit its cache and need not be made during casts."""


class StoredTrees:
    """The triangle trees of a geometry. trees: as given; on the CPU they share the geometry's arrays of triangles."""

    def __init__(self, geometry: Geometry, trees: Sequence[TriangleTree], device: wp.Device) -> None:
        self.trees = list(trees)
        self._geometry, self._device = geometry, device
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
        g.blocks = wp.array(blocks, dtype=TriangleBlock, device=self._device, copy=False)
        self._first_plot: int | None = None  # index of the first node that is a plot
        if self._device.is_cpu:
            g.plots = wp.array(plots, dtype=Plot, device=self._device, copy=False)
            g.sides = wp.array(sides, dtype=float, device=self._device, copy=False)
        if not self._device.is_cpu or len(plots) <= MOST_STORED:
            self._first_plot = len(nodes)
            patches = patches_of(plots, sides)
            nodes = np.concatenate([lead_to_nodes(nodes, len(nodes)), nodes_of(patches)])
            if not self._device.is_cpu:
                g.patches = wp.array(patches, dtype=Patch, device=self._device)
        g.nodes = self._on_device(nodes)
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

    def _on_device(self, nodes: npt.NDArray[np.void]) -> wp.array:
        return wp.array(nodes if self._device.is_cpu else by_ends(nodes), dtype=Node, device=self._device, copy=False)

    def _overwrite(self, index: int) -> None:
        place, g = self._places[index], self._geometry
        tree = moved_tree(self.trees[index], place)
        nodes = tree.nodes if self._first_plot is None else lead_to_nodes(tree.nodes, self._first_plot)
        wp.copy(g.nodes, self._on_device(nodes), dest_offset=place.node)
        wp.copy(g.blocks, wp.array(tree.blocks, dtype=TriangleBlock, device=self._device), dest_offset=place.block)
        if not len(tree.plots):
            return
        if self._device.is_cpu:
            wp.copy(g.plots, wp.array(tree.plots, dtype=Plot, device="cpu"), dest_offset=place.plot)
            wp.copy(g.sides, wp.array(tree.sides, dtype=float, device="cpu"), dest_offset=place.side)
        if self._first_plot is not None:
            self._overwrite_plots(tree, place.plot, self._first_plot + place.plot)

    def _overwrite_plots(self, tree: TriangleTree, first: int, first_node: int) -> None:
        """Overwrite the nodes of a tree's plots and, on CUDA, their patches."""
        g, first_patch = self._geometry, PATCHES * first
        patches = patches_of(tree.plots, tree.sides, tree.first_side)
        wp.copy(g.nodes, self._on_device(nodes_of(patches, first_patch)), dest_offset=first_node)
        if not self._device.is_cpu:
            wp.copy(g.patches, wp.array(patches, dtype=Patch, device=self._device), dest_offset=first_patch)


def _on_cache_lines(values: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """A copy that begins on a cache line. It is in memory of numpy, which asks Linux for huge pages; Warp does not."""
    room = np.empty(values.nbytes + CACHE_LINE, np.uint8)
    first = -room.ctypes.data % CACHE_LINE
    copy = room[first : first + values.nbytes].view(values.dtype)
    copy[...] = values
    return copy
