"""The trees over the shapes of a geometry, one per span: copied, refitted, and rebuilt when their boxes get loose."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.launching.slices import launch_over_rays, prepare_over_rays
from rigcast.kernels.trees.fit import REBUILD_RATIO, Fit
from rigcast.kernels.trees.fours import boxes_of_leaves, in_fours, levels_of
from rigcast.kernels.trees.nodes import NO_CHILD, WIDTH, Four, Node, empty_nodes, join_trees
from rigcast.kernels.trees.tree import build_tree

from .top_level import Refit, ShapeBoxes, copy_to_trees, first_boxes, refit, turn_shapes

LEAVES_PER_SLICE = 4096
"""Number of shapes, over several trees, that a CPU thread refits per slice."""
_BYTES_PER_NODE = wp.types.type_size_in_bytes(Node) + wp.types.type_size_in_bytes(Fit)
_BYTES_PER_TREE = 32  # its anchor, reach and area
BYTES_PER_SHAPE = 96
"""Most bytes per shape of a world's tree when there are several worlds, for three shapes or more."""


class TopTrees:
    """Keeps `top`, `anchor`, `top_reach` and `turn` of a geometry up to date, whose shapes and poses are set.

    All trees share the topology of one tree, built by the surface-area heuristic from the shapes' boxes at the last
    build, each in the first span in which it had one. With several worlds the leaves are grouped into full nodes if the
    tree would take more than BYTES_PER_SHAPE.
    """

    def __init__(self, geometry: Geometry, device: wp.Device) -> None:
        self._geometry, self._device = geometry, device
        self._anchor_shape = 0
        self._built_area = -1.0
        self._worlds, self._spans, self._instants = 0, 0, 0
        self._seen: wp.array | None = None
        self._is_seen: wp.Event | None = None
        self._set_nodes(empty_nodes(1), *np.zeros((2, 0, 3), np.float32))

    @property
    def launch(self) -> Callable[[], object]:
        """The launch of a refit; it holds the arrays that it uses, besides the geometry's."""
        return self._launch

    @property
    def bytes_per_tree(self) -> int:
        """Bytes of one tree with the Fit of its nodes; an upper bound before several worlds are first fitted."""
        nodes = sum(self._nodes.size * wp.types.type_size_in_bytes(each) for each in (self._nodes.dtype, Fit))
        if self._worlds < 2:
            nodes = max(_BYTES_PER_NODE, BYTES_PER_SHAPE * self._geometry.kind.size)
        return nodes + _BYTES_PER_TREE

    def fit(self, worlds: int, instants: int) -> None:
        """Fit the trees to the geometry's poses, of `worlds` worlds at `instants` instants each."""
        g, device = self._geometry, self._device
        spans = worlds * max(instants - 1, 1)
        if (worlds > 1) != (self._worlds > 1):
            self._built_area = -1.0
        self._worlds = worlds
        if (spans, instants) != (self._spans, self._instants):
            self._spans, self._instants, g.instants = spans, instants, instants
            g.turn = wp.empty(spans * g.kind.size if instants > 1 else 0, dtype=wp.vec3d, device=device)
            g.anchor = wp.zeros(spans, dtype=wp.vec3d, device=device)
            g.top_reach = wp.zeros(spans, dtype=float, device=device)
            self._area = wp.zeros(spans, dtype=float, device=device)
            self._area_view = self._area.numpy() if device.is_cpu else None
            self._copy_to_trees()
        self.refit()

    def refit(self) -> None:
        """Fit the trees to the present poses; the numbers of worlds and instants must not have changed."""
        if self._instants > 1:
            launch_over_rays(turn_shapes, self._geometry.turn.size, [self._geometry], [], self._device)
        self._launch()
        if self._mean_area() > REBUILD_RATIO * self._built_area:
            self._build()

    def _build(self) -> None:
        """Rebuild the trees, and anchor them at a shape near the middle of the scene."""
        lower, upper = self._first_boxes()
        is_bounded = np.isfinite(lower.min(axis=1))
        nodes = _tree_over(lower, upper, is_bounded, leaf_size=1)
        is_large = len(nodes) * _BYTES_PER_NODE > BYTES_PER_SHAPE * len(lower)
        if self._device.is_cpu and self._worlds > 1 and is_large:
            nodes = _tree_over(lower, upper, is_bounded, leaf_size=WIDTH)
        bounded = np.flatnonzero(is_bounded)
        if bounded.size:
            # near the median, so that one shape far away does not loosen the boxes of all others
            center = 0.5 * lower[bounded] + 0.5 * upper[bounded]
            median = np.sort(center, axis=0)[len(center) // 2]
            offset = np.abs(center - median).max(axis=1)
            self._anchor_shape = int(bounded[np.argmin(offset)])
        self._set_nodes(nodes, lower, upper)
        self._copy_to_trees()
        self._launch()
        self._built_area = float(self._area.numpy().mean())
        self._seen = None  # else the area before would be seen at the next refit

    def _set_nodes(
        self, nodes: npt.NDArray[np.void], lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32]
    ) -> None:
        """Take the nodes of a tree over shapes with these boxes (n, 3); on CUDA in fours."""
        if self._device.is_cpu:
            self._nodes = wp.array(nodes, dtype=Node, device=self._device)
            return
        fours = in_fours(nodes["child"], *boxes_of_leaves(nodes["child"], lower, upper))
        self._levels = levels_of(fours)
        self._nodes = wp.array(fours, dtype=Four, device=self._device)

    def _copy_to_trees(self) -> None:
        """Copy the present nodes to the tree of every span."""
        count = self._spans * self._nodes.size
        these = Refit()
        self._fits = wp.empty(count, dtype=Fit, device=self._device)
        these.anchor_shape, these.fits, these.area = self._anchor_shape, self._fits, self._area
        top = wp.empty(count, dtype=self._nodes.dtype, device=self._device)
        self._geometry.top_count = self._nodes.size
        if self._device.is_cpu:
            self._geometry.top = top
            launch_over_rays(copy_to_trees, count, [self._nodes], [top], self._device)
            trees = max(1, LEAVES_PER_SLICE // max(1, self._geometry.kind.size))
            self._launch = prepare_over_rays(refit, self._spans, [self._geometry, these], [], self._device, trees)
        else:
            self._geometry.top_fours = top
            self._launch = self._refit_in_blocks(these)

    def _refit_in_blocks(self, these: Refit) -> Callable[[], object]:
        """Copy the present nodes to the tree of every span on CUDA; return the launch of a refit."""
        from .refit_in_blocks import BLOCK, copy_to_trees_of_fours, refit_in_blocks  # here, as only CUDA needs it

        top, device = self._geometry.top_fours, self._device
        # in blocks of BLOCK threads, as Warp compiles the module for one block size
        recorded(copy_to_trees_of_fours, top.size, [self._nodes], [top], device, BLOCK)()
        levels = wp.array(self._levels, dtype=int, device=device)
        return recorded(refit_in_blocks, self._spans * BLOCK, [self._geometry, levels, these], [], device, BLOCK)

    def _first_boxes(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        shapes = self._geometry.kind.size
        boxes = ShapeBoxes()
        boxes.lower, boxes.upper = (wp.empty(shapes, dtype=wp.vec3, device=self._device) for _ in range(2))
        launch_over_rays(first_boxes, shapes, [self._geometry, self._anchor_shape], [boxes], self._device)
        return boxes.lower.numpy(), boxes.upper.numpy()

    def _mean_area(self) -> float:
        """Mean area of the trees' boxes. On CUDA, once built, that of an earlier refit, to avoid waiting."""
        if self._area_view is not None:
            return float(self._area_view.sum()) / self._spans if self._spans > 1 else self._area_view.item()
        if self._built_area < 0:
            return float(self._area.numpy().mean())
        if self._device.is_capturing:
            return 0.0
        if self._seen is None or self._seen.size != self._spans:
            self._seen, self._is_seen = wp.zeros(self._spans, dtype=float, device="cpu", pinned=True), None
        if self._is_seen is not None and not self._is_seen.is_complete:
            return 0.0
        area = float(self._seen.numpy().mean())
        wp.copy(self._seen, self._area)
        self._is_seen = self._device.stream.record_event()
        return area


def _tree_over(
    lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32], is_bounded: npt.NDArray[np.bool_], leaf_size: int
) -> npt.NDArray[np.void]:
    """Nodes of a tree over all shapes; leaf ~k is shape k."""
    nodes = _tree_of(np.flatnonzero(is_bounded), lower, upper, leaf_size)
    if is_bounded.all():
        return nodes
    # unbounded shapes, and those without a finite pose so far
    nowhere = np.zeros_like(lower)
    return join_trees(nodes, _tree_of(np.flatnonzero(~is_bounded), nowhere, nowhere, WIDTH))


def _tree_of(
    shapes: npt.NDArray[np.intp], lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32], leaf_size: int
) -> npt.NDArray[np.void]:
    """Nodes of a tree over some of the shapes; a leaf with several shapes becomes a node over them."""
    # with room on the stack for a node over the shapes of a leaf, and for the one that join_trees adds
    tree = build_tree(lower[shapes], upper[shapes], leaf_size, spare=2 * WIDTH)
    lane = np.arange(WIDTH)
    place = np.minimum(tree.leaf_first[:, None] + lane, shapes.size - 1)
    members = np.where(lane < tree.leaf_count[:, None], ~shapes[tree.order[place]], NO_CHILD)
    is_alone = tree.leaf_count == 1
    added = empty_nodes(int((~is_alone).sum()))
    added["child"] = members[~is_alone]
    if len(members) == 1 and len(added) == 1:
        return added
    of_leaf = np.where(is_alone, members[:, 0], len(tree.nodes) - 1 + np.cumsum(~is_alone))
    child = tree.nodes["child"]
    is_leaf = (child < 0) & (child != NO_CHILD)
    child[is_leaf] = of_leaf[~child[is_leaf]]
    return np.concatenate([tree.nodes, added])
