"""Shapes that move, on one device.

Triangle trees are copied there once, poses and the tree over shapes at every update.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

from .geometry import Geometry, Shapes, TriangleBlock, TriangleTree, join_triangle_trees, moved_nodes
from .top_level import REBUILD_RATIO, refit, shape_boxes
from .tree import NO_CHILD, Node, build_tree, empty_nodes, join_trees


class World:
    """Triangle trees and the shapes that place them, ready to be cast against as `geometry`.

    Updates are worked out on the CPU, where MuJoCo's poses are, and copied to the device.
    """

    def __init__(self, trees: Sequence[TriangleTree], shapes: Shapes, device: wp.DeviceLike) -> None:
        self.device = wp.get_device(device)
        self.geometry = Geometry()
        self._trees = list(trees)
        self._join_trees()
        count = len(shapes.kind)
        self._position = wp.zeros(count, dtype=wp.vec3d, device="cpu")
        self._rotation = wp.zeros(count, dtype=wp.mat33d, device="cpu")
        self._anchor = wp.zeros(1, dtype=wp.vec3d, device="cpu")
        self._reach = wp.zeros(1, dtype=float, device="cpu")
        self._area = wp.zeros(1, dtype=float, device="cpu")
        self._lower, self._upper = (wp.zeros(count, dtype=wp.vec3, device="cpu") for _ in range(2))
        self._built_area = 0.0
        self._is_in_tree = np.zeros(count, dtype=bool)
        self._set_nodes(empty_nodes(1))
        self.set_shapes(shapes)

    def set_shapes(self, shapes: Shapes) -> None:
        """Take other sizes and local boxes; the number of shapes stays. The next update makes them count."""
        g, device = self.geometry, self.device
        self._tree_of_shape = shapes.tree
        g.kind = wp.array(shapes.kind, dtype=int, device=device)
        g.size = wp.array(shapes.size, dtype=wp.vec3, device=device)
        g.root = wp.array(self._root_of_shape(), dtype=int, device=device)
        g.reach = wp.array(shapes.reach, dtype=float, device=device)
        self._center = wp.array(shapes.center, dtype=wp.vec3, device="cpu")
        self._half = wp.array(shapes.half, dtype=wp.vec3, device="cpu")
        g.center = self._center.to(device)
        g.half = self._half.to(device)

    def set_tree(self, index: int, tree: TriangleTree) -> None:
        """Take another triangle tree in place of one; shapes whose boxes change with it must be set too."""
        old, self._trees[index] = self._trees[index], tree
        if len(old.nodes) == len(tree.nodes) and len(old.blocks) == len(tree.blocks):
            self._overwrite_tree(index)
        else:
            self._join_trees()
            self.geometry.root = wp.array(self._root_of_shape(), dtype=int, device=self.device)

    def _join_trees(self) -> None:
        nodes, blocks, self._roots = join_triangle_trees(self._trees)
        self.geometry.nodes = wp.array(nodes, dtype=Node, device=self.device)
        self.geometry.blocks = wp.array(blocks, dtype=TriangleBlock, device=self.device)

    def _overwrite_tree(self, index: int) -> None:
        tree = self._trees[index]
        first_node = int(self._roots[index])
        first_block = sum(len(t.blocks) for t in self._trees[:index])
        nodes = wp.array(moved_nodes(tree.nodes, first_node, first_block), dtype=Node, device=self.device)
        blocks = wp.array(tree.blocks, dtype=TriangleBlock, device=self.device)
        wp.copy(self.geometry.nodes, nodes, dest_offset=first_node)
        wp.copy(self.geometry.blocks, blocks, dest_offset=first_block)

    def _root_of_shape(self) -> npt.NDArray[np.int32]:
        return np.append(self._roots, np.int32(0))[self._tree_of_shape]

    def update(self, position: npt.NDArray[np.float64], rotation: npt.NDArray[np.float64]) -> None:
        """Take the shapes' poses: position (n, 3) [m], rotation (n, 9) row-major. A pose with NaN is never hit."""
        self._position.numpy()[...] = position
        self._rotation.numpy()[...] = rotation.reshape(-1, 3, 3)
        has_box = self._refit()
        if (has_box & ~self._is_in_tree).any() or self._area.numpy()[0] > REBUILD_RATIO * self._built_area:
            self._rebuild(has_box)
        self._copy_to_device()

    def _refit(self) -> npt.NDArray[np.bool_]:
        """Fit the tree to the poses; return (n,) which shapes have a box."""
        poses = [self._position, self._rotation, self._center, self._half, self._anchor]
        boxes = [self._lower, self._upper]
        wp.launch(shape_boxes, len(self._position), inputs=poses, outputs=boxes, device="cpu")
        scratch = [self._node_lower, self._node_upper, self._nodes]
        wp.launch(refit, 1, inputs=[*boxes, *scratch], outputs=[self._area, self._reach], device="cpu")
        return self._lower.numpy()[:, 0] <= self._upper.numpy()[:, 0]

    def _rebuild(self, has_box: npt.NDArray[np.bool_]) -> None:
        """Build the tree over all shapes that have a box, around an anchor in their midst."""
        lower, upper = self._lower.numpy(), self._upper.numpy()
        is_bounded = has_box & np.isfinite(lower[:, 0])
        nodes = _tree_over(np.flatnonzero(is_bounded), lower, upper)
        if not is_bounded.all():
            unbounded = np.flatnonzero(has_box & ~is_bounded)
            nodes = join_trees(nodes, _tree_over(unbounded, np.zeros_like(lower), np.zeros_like(upper)))
        if is_bounded.any():
            # the median, as one shape that has gone astray must not loosen the boxes of all others
            self._anchor.numpy()[0] += np.median(0.5 * lower[is_bounded] + 0.5 * upper[is_bounded], axis=0)
        self._set_nodes(nodes)
        self._is_in_tree = has_box
        self._refit()
        self._built_area = float(self._area.numpy()[0])

    def _set_nodes(self, nodes: npt.NDArray[np.void]) -> None:
        self._nodes = wp.array(nodes, dtype=Node, device="cpu")
        self._node_lower, self._node_upper = (wp.empty(len(nodes), dtype=wp.vec3, device="cpu") for _ in range(2))

    def _copy_to_device(self) -> None:
        g, device = self.geometry, self.device
        g.position = self._position.to(device)
        g.rotation = self._rotation.to(device)
        g.top = self._nodes.to(device)
        g.anchor = self._anchor.to(device)
        g.top_reach = self._reach.to(device)


def _tree_over(
    shapes: npt.NDArray[np.intp], lower: npt.NDArray[np.float32], upper: npt.NDArray[np.float32]
) -> npt.NDArray[np.void]:
    """Nodes of a tree over some of the shapes; leaf ~k is shape k."""
    tree = build_tree(lower[shapes], upper[shapes], leaf_size=1)
    child = tree.nodes["child"]
    is_leaf = (child < 0) & (child != NO_CHILD)
    child[is_leaf] = ~shapes[tree.order[tree.leaf_first[~child[is_leaf]]]].astype(np.int32)
    return tree.nodes
