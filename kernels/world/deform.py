"""Triangle trees whose vertices move: cloth, soft bodies, skins.

When vertices move, the tree keeps its topology and is refitted: boxes and normals are recomputed, which takes a small
fraction of the time of a build. Boxes overlap more and more with this. When their total area, the cost of a ray by the
surface-area heuristic, has grown by REBUILD_RATIO, the tree is rebuilt.
"""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import FARTHEST, TriangleBlock
from rigcast.kernels.launching.launch import launch
from rigcast.kernels.trees.fit import REBUILD_RATIO, Fit, fit_of_leaf, make_box, no_fit, with_child, with_own_box
from rigcast.kernels.trees.nodes import NO_CHILD, WIDTH, Node, set_child
from rigcast.kernels.trees.tree import build_tree

from .arrays import TriangleTree
from .triangle_tree import blocks_of, fill, lend, require_in_range, whole_box

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.kernel
def fit_tree(
    # boxes of the leaves:
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    # in and out:
    nodes: wp.array[Node],
    # out:
    fits: wp.array[Fit],
) -> None:
    """Refit the boxes of all nodes to those of the leaves in one thread, children first; leaf ~k has box k."""
    for k in range(nodes.shape[0]):
        at = nodes.shape[0] - 1 - k
        node = nodes[at]
        whole = no_fit()
        for j in range(WIDTH):
            child = node.child[j]
            if child != NO_CHILD:
                fit = Fit()
                if child >= 0:  # noqa: SIM108
                    fit = fits[child]
                else:
                    fit = fit_of_leaf(make_box(lower[-1 - child], upper[-1 - child]))
                node = set_child(node, j, fit.box, child)
                whole = with_child(whole, fit)
        nodes[at] = node
        fits[at] = with_own_box(whole)


class DeformingTree:
    """A tree over triangles whose vertices move. Faces are not hit while they have no area.

    Args:
        vertices: (n, 3) [m], initial positions.
        faces: (m, 3) indices into vertices, counter-clockwise seen from outside.

    Raises:
        ValueError: a face with an index out of range, or a vertex that is not finite or too large.
    """

    def __init__(self, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        start = np.asarray(vertices, np.float32)
        corners = np.asarray(faces).reshape(-1, 3)
        require_in_range(corners, len(start))
        self._faces = corners.astype(np.int32)
        self._faces_on_cpu = wp.array(self._faces, dtype=wp.vec3i, device="cpu")  # a copy, with the present winding
        self._build(_checked(start))

    @property
    def tree(self) -> TriangleTree:
        """The tree as it is now; the next move overwrites its arrays."""
        return TriangleTree(self._nodes.numpy(), self._blocks.numpy(), *whole_box(*self._boxes), dropped=0)

    def move(self, vertices: npt.ArrayLike, is_turned: npt.NDArray[np.bool_] | None = None) -> TriangleTree:
        """Move the vertices to positions (n, 3) [m], with coordinates up to FARTHEST; return the updated tree.

        is_turned: (m,) which faces are now clockwise seen from outside; None for none.

        Raises:
            ValueError: a vertex that is not finite or too large.
        """
        moved = _checked(np.asarray(vertices, np.float32))
        if is_turned is not None:
            self._faces_on_cpu.numpy()[...] = np.where(is_turned[:, None], self._faces[:, ::-1], self._faces)
        self._refit(moved)
        if self._area > REBUILD_RATIO * self._built_area:
            self._build(moved)
        return self.tree

    def _build(self, vertices: npt.NDArray[np.float32]) -> None:
        corners = vertices[self._faces]
        built = build_tree(corners.min(axis=1), corners.max(axis=1), leaf_size=WIDTH)
        self._nodes = lend(built.nodes, Node)
        self._blocks = lend(blocks_of(built, np.arange(len(corners))), TriangleBlock)
        self._fits = wp.empty(len(built.nodes), dtype=Fit, device="cpu")
        self._refit(vertices)
        self._built_area = self._area

    def _refit(self, vertices: npt.NDArray[np.float32]) -> None:
        """Recompute corners, normals and boxes for moved vertices."""
        self._boxes = fill(self._blocks, lend(vertices, wp.vec3), self._faces_on_cpu)
        boxes = [lend(ends, wp.vec3) for ends in self._boxes]
        launch(fit_tree, 1, boxes, [self._nodes, self._fits], "cpu")

    @property
    def _area(self) -> float:
        """Total half area of the tree's boxes [m^2]."""
        return float(self._fits.numpy()["area"][0])


def _checked(vertices: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    bad = ~(np.abs(vertices) <= FARTHEST).all(axis=-1)
    if bad.any():
        vertex = int(np.argmax(bad))
        got = vertices[vertex].tolist()
        raise ValueError(f"vertex {vertex}: got {got}, expected finite numbers up to {FARTHEST:g} m")
    return vertices
