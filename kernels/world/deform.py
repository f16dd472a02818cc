"""Triangle trees whose vertices move: cloth, soft bodies, skins.

Moving the vertices keeps the tree's structure and fits its boxes and normals to the new triangles, which takes a small
part of the time of a build. Boxes that once lay side by side overlap more and more; when their areas, which the
surface-area heuristic takes for the cost of a ray, have grown by REBUILD_RATIO, the tree is built anew.
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
from .triangle_tree import blocks_of, fill, on_cpu, whole_box

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
    """One thread: fit the boxes of all nodes to those of the leaves, children first; leaf ~k has box k."""
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
    """A tree over triangles whose vertices move. A face is not hit while it has no area.

    Args:
        vertices: (n, 3) [m], as at the start.
        faces: (m, 3) indices into vertices, counter-clockwise seen from outside.

    Raises:
        ValueError: a face with an index out of range, or a vertex that is not finite or too large.
    """

    def __init__(self, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        start = np.asarray(vertices, np.float32)
        corners = np.asarray(faces).reshape(-1, 3)
        if corners.size and not (corners.min() >= 0 and corners.max() < len(start)):
            face = int(np.argmax(((corners < 0) | (corners >= len(start))).any(axis=1)))
            raise ValueError(f"face {face}: got vertices {corners[face].tolist()}, expected 0 to {len(start) - 1}")
        self._faces = corners.astype(np.int32)
        self._faces_on_cpu = wp.array(self._faces, dtype=wp.vec3i, device="cpu")  # a copy, as they are wound by now
        self._build(_checked(start))

    @property
    def tree(self) -> TriangleTree:
        """As it is now. Its arrays are overwritten by the next move."""
        return TriangleTree(self._nodes.numpy(), self._blocks.numpy(), *whole_box(*self._boxes), dropped=0)

    def move(self, vertices: npt.ArrayLike, is_turned: npt.NDArray[np.bool_] | None = None) -> TriangleTree:
        """Take other places (n, 3) [m] of the vertices, up to FARTHEST in size; return the tree as it is now.

        is_turned: (m,) which faces are clockwise by now, seen from outside; None: none.

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
        self._nodes = on_cpu(built.nodes, Node)
        self._blocks = on_cpu(blocks_of(built, np.arange(len(corners))), TriangleBlock)
        self._fits = wp.empty(len(built.nodes), dtype=Fit, device="cpu")
        self._refit(vertices)
        self._built_area = self._area

    def _refit(self, vertices: npt.NDArray[np.float32]) -> None:
        """Corners, normals and boxes of the present structure, for vertices that have moved."""
        self._boxes = fill(self._blocks, on_cpu(vertices, wp.vec3), self._faces_on_cpu)
        boxes = [on_cpu(ends, wp.vec3) for ends in self._boxes]
        launch(fit_tree, 1, boxes, [self._nodes, self._fits], "cpu")

    @property
    def _area(self) -> float:
        """Of all boxes of the tree."""
        return float(self._fits.numpy()["area"][0])


def _checked(vertices: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    bad = ~(np.abs(vertices) <= FARTHEST).all(axis=-1)
    if bad.any():
        vertex = int(np.argmax(bad))
        got = vertices[vertex].tolist()
        raise ValueError(f"vertex {vertex}: got {got}, expected finite numbers up to {FARTHEST:g} m")
    return vertices
