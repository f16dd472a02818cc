"""What rays are cast against: triangle trees, built once, and the shapes that place them in the world.

A *shape* is one closed-form solid or one instance of a triangle tree, with a pose. Poses are float64, so that the
difference between a ray's origin and a shape loses nothing however far both are from the world's origin; those of
simulations that know them in float32 are used as they are.

There may be many *worlds* of the same shapes, and each may be known at one *instant* or at several. A ray is cast
through one *span*: a world at its only instant, or what moves between two following ones. Every span has its own tree
over the shapes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from .tree import NO_CHILD, WIDTH, Node, build_tree, struct_zeros, vec8, vec8i

NO_FACE = wp.constant(-1)
FARTHEST = wp.constant(1.0e18)
"""Origins, positions, vertices and sizes [m] beyond this, in any coordinate, could overflow float32 where they are
multiplied: geometry there is refused or never hit, and rays from there give NaN."""


@wp.struct
class TriangleBlock:
    """Up to eight triangles and their unit normals, coordinate by coordinate; an absent one is all NaN."""

    x0: vec8
    y0: vec8
    z0: vec8
    x1: vec8
    y1: vec8
    z1: vec8
    x2: vec8
    y2: vec8
    z2: vec8
    normal_x: vec8
    normal_y: vec8
    normal_z: vec8
    face: vec8i


@wp.struct
class Geometry:
    """All that a cast reads.

    Shapes 0..n-1 have a kind (PLANE..SHEET of rigcast.kernels.solids), a size as there, and a pose in the world. With I
    instants in each of W worlds, I > 1, there are S = (I - 1) W spans, else S = W.
    """

    # triangle trees:
    nodes: wp.array[Node]
    blocks: wp.array[TriangleBlock]
    # shapes:
    kind: wp.array[int]  # (n,)
    # (n,) for all worlds, or (W n,):
    size: wp.array[wp.vec3]
    root: wp.array[int]  # node of the triangle tree's root
    center: wp.array[wp.vec3]  # of the shape's box in its own frame, and the half size
    half: wp.array[wp.vec3]
    reach: wp.array[float]  # largest |coordinate| of the shape in its own frame
    # poses (W I n,), in float64 or in float32, the others are empty; of shapes that move, (firings n,) for the cast:
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]  # columns: the shape's axes in the world
    position_float: wp.array[wp.vec3]
    rotation_float: wp.array[wp.mat33]
    instants: int  # I
    turn: wp.array[wp.vec3d]  # (S n,) rotation vector from a span's first instant to its second; empty where I is 1
    # the trees over the shapes, relative to an anchor each:
    top: wp.array[Node]  # (S m,)
    top_count: int  # m, the nodes of each
    anchor: wp.array[wp.vec3d]  # (S,)
    top_reach: wp.array[float]  # (S,) largest |coordinate| of the tree's boxes


@dataclass(frozen=True)
class TriangleTree:
    """A tree over triangles, in the frame of its vertices; child ~k of a node is block k.

    dropped: how many faces had no area and were left out.
    """

    nodes: npt.NDArray[np.void]
    blocks: npt.NDArray[np.void]
    lower: npt.NDArray[np.float32]
    upper: npt.NDArray[np.float32]
    dropped: int


def build_triangle_tree(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> TriangleTree:
    """Build a tree over triangles.

    Args:
        vertices: (n, 3) float32 [m], up to FARTHEST in size.
        faces: (m, 3) indices into vertices, counter-clockwise seen from outside. Faces without area are dropped.

    Raises:
        ValueError: a face with an index out of range or a vertex that is not finite or too large.
    """
    corners = _corners(np.asarray(vertices, np.float64), np.asarray(faces))
    edges = corners[:, 1:].astype(np.float64) - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    areas = np.linalg.norm(normals, axis=1)
    face = np.flatnonzero(areas)
    corners = corners[face]
    normals = normals[face] / areas[face, None]
    first, second, third = np.moveaxis(corners, 1, 0)  # several times as fast as corners.min(axis=1)
    lower, upper = (extreme(extreme(first, second), third) for extreme in (np.minimum, np.maximum))
    tree = build_tree(lower, upper, leaf_size=WIDTH)
    lane = np.arange(WIDTH)
    is_absent = lane >= tree.leaf_count[:, None]
    blocks = struct_zeros(TriangleBlock, len(is_absent))
    if len(face):
        triangle = tree.order[np.where(is_absent, 0, tree.leaf_first[:, None] + lane)]
        for k, axis in enumerate("xyz"):
            for corner in range(3):
                blocks[f"{axis}{corner}"] = np.where(is_absent, np.nan, corners[triangle, corner, k])
            blocks[f"normal_{axis}"] = np.where(is_absent, np.nan, normals[triangle, k])
        blocks["face"] = np.where(is_absent, NO_FACE, face[triangle])
    if not len(face):
        lower = upper = np.zeros((1, 3), np.float32)
    return TriangleTree(tree.nodes, blocks, lower.min(axis=0), upper.max(axis=0), len(edges) - len(face))


def _corners(vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.integer]) -> npt.NDArray[np.float32]:
    """(m, 3, 3) float32: the vertices of each face."""
    out_of_range = (faces < 0) | (faces >= len(vertices))
    if out_of_range.any():
        face, corner = np.argwhere(out_of_range)[0]
        raise ValueError(f"face {face}: got vertex {faces[face, corner]}, expected 0 to {len(vertices) - 1}")
    corners = vertices[faces].reshape(-1, 3, 3)
    bad = ~(np.abs(corners) <= FARTHEST).all(axis=-1)
    if bad.any():
        face, corner = np.argwhere(bad)[0]
        where = f"face {face}: vertex {faces[face, corner]}"
        raise ValueError(f"{where}: got {corners[face, corner].tolist()}, expected finite numbers up to {FARTHEST:g} m")
    return corners.astype(np.float32)


def join_triangle_trees(
    trees: Sequence[TriangleTree],
) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void], npt.NDArray[np.int32]]:
    """All trees in one array of nodes and one of blocks, and the root of each."""
    roots = np.cumsum([0, *(len(t.nodes) for t in trees)])[:-1].astype(np.int32)
    first_blocks = np.cumsum([0, *(len(t.blocks) for t in trees)])[:-1]
    moved = [moved_nodes(t.nodes, int(r), int(b)) for t, r, b in zip(trees, roots, first_blocks, strict=True)]
    nodes = np.concatenate([struct_zeros(Node, 0), *moved])
    blocks = np.concatenate([struct_zeros(TriangleBlock, 0), *(t.blocks for t in trees)])
    return nodes, blocks, roots


def moved_nodes(nodes: npt.NDArray[np.void], first_node: int, first_block: int) -> npt.NDArray[np.void]:
    """The nodes of a tree whose root and first block stand at these places of longer arrays."""
    moved = nodes.copy()
    child = moved["child"]
    offset = np.where(child >= 0, first_node, -first_block)
    moved["child"] = np.where(child == NO_CHILD, NO_CHILD, child + offset)
    return moved


@dataclass(frozen=True)
class Shapes:
    """Shapes as numpy arrays: kind and size as in rigcast.kernels.solids, and boxes in their own frames.

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
    def joined(parts: "Sequence[Shapes]", first_tree: npt.NDArray[np.int_]) -> "Shapes":
        """All shapes in one; the trees of part k are counted from first_tree[k]."""
        tree = [np.where(p.tree >= 0, p.tree + first, -1) for p, first in zip(parts, first_tree, strict=True)]
        return Shapes(
            np.concatenate([p.kind for p in parts]),
            np.concatenate([p.size for p in parts]),
            np.concatenate(tree).astype(np.int32),
            np.concatenate([p.center for p in parts]),
            np.concatenate([p.half for p in parts]),
        )
