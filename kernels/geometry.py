"""What rays are cast against: triangle trees, built once, and the shapes that place them in the world.

A *shape* is one closed-form solid or one instance of a triangle tree, with a pose. Poses are float64, so that the
difference between a ray's origin and a shape loses nothing however far both are from the world's origin; those of
simulations that know them in float32 are used as they are.

There may be many *worlds* of the same shapes, and each may be known at one *instant* or at several. A ray is cast
through one *span*: a world at its only instant, or what moves between two following ones. Every span has its own tree
over the shapes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from .trees.nodes import FIRST_PATCH, Node, moved_nodes, struct_zeros, vec8, vec8i

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
class Patch:
    """Two by two cells of the surface of a height field, which fill a cache line; see rigcast.kernels.shapes.patches.

    Where there are but one row or column of cells, y or x of the last corners is NaN, and z that of those before.
    """

    x: wp.vec3  # of the columns of corners
    y: wp.vec3  # of the rows
    z: wp.mat33  # row by row
    face: int  # the lower one of the first cell


@wp.struct
class Geometry:
    """All that a cast reads.

    Casts have it in an array of one: Warp gives functions copies of structs, and of this one they are large.

    Shapes 0..n-1 have a kind (PLANE..SHEET of rigcast.kernels.shapes.solids), a size as there, and a pose in the world.
    With I instants in each of W worlds, I > 1, there are S = (I - 1) W spans, else S = W.
    """

    # triangle trees:
    nodes: wp.array[Node]
    blocks: wp.array[TriangleBlock]
    patches: wp.array[Patch]
    # shapes:
    kind: wp.array[int]  # (n,)
    twin: wp.array[int]  # an earlier shape of the same kind and triangle tree, or -1
    visible: wp.array[wp.bool]  # of a cast, or empty; (n,) for all worlds, or (W n,)
    # (n,) for all worlds, or (W n,):
    size: wp.array[wp.vec3]
    root: wp.array[int]  # node of the triangle tree's root
    columns: wp.array[int]  # how many cells of a height field are in a row
    center: wp.array[wp.vec3]  # of the shape's box in its own frame, and the half size
    half: wp.array[wp.vec3]
    reach: wp.array[float]  # largest |coordinate| of the shape in its own frame
    # poses (W I n,), in float64 or in float32, the others are empty; for the cast as
    # rigcast.kernels.poses.moving has them:
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]  # columns: the shape's axes in the world
    position_float: wp.array[wp.vec3]
    rotation_float: wp.array[wp.mat33]
    instants: int  # I
    movers: wp.array[int]  # the shapes that do not stand still through all instants; both empty where I is 1
    place: wp.array[int]  # (n,) of each shape among these, -1 of what stands still
    turn: wp.array[wp.vec3d]  # (S n,) rotation vector from a span's first instant to its second; empty where I is 1
    # the trees over the shapes, relative to an anchor each:
    top: wp.array[Node]  # (S m,)
    top_count: int  # m, the nodes of each
    anchor: wp.array[wp.vec3d]  # (S,)
    top_reach: wp.array[float]  # (S,) largest |coordinate| of the tree's boxes


@dataclass(frozen=True)
class TriangleTree:
    """A tree over triangles, in the frame of its vertices; child ~k of a node is block k, ~(FIRST_PATCH + k) patch k.

    dropped: how many faces had no area and were left out. patches, columns: of a height field, see Geometry.
    """

    nodes: npt.NDArray[np.void]
    blocks: npt.NDArray[np.void]
    lower: npt.NDArray[np.float32]
    upper: npt.NDArray[np.float32]
    dropped: int
    patches: npt.NDArray[np.void] = field(default_factory=lambda: struct_zeros(Patch, 0))
    columns: int = 0


class TreePlace(NamedTuple):
    """Where in joined arrays a tree's nodes, blocks and patches begin."""

    node: int
    block: int
    patch: int


def join_triangle_trees(
    trees: Sequence[TriangleTree],
) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void], npt.NDArray[np.void], list[TreePlace]]:
    """All trees in one array of nodes, one of blocks and one of patches, and where in these each begins.

    Raises ValueError for more blocks or patches than there are numbers for.
    """
    sizes = np.array([(len(tree.nodes), len(tree.blocks), len(tree.patches)) for tree in trees]).reshape(-1, 3)
    _, blocks, patches = sizes.sum(axis=0)
    if max(blocks, patches) > FIRST_PATCH:
        got = f"{blocks} blocks of stored triangles and {patches} patches of height fields"
        raise ValueError(f"triangle trees: got {got}, expected up to {FIRST_PATCH} of each")
    places = [TreePlace(*place) for place in (np.cumsum(sizes, axis=0) - sizes).tolist()]
    nodes = [moved_nodes(tree.nodes, *place) for tree, place in zip(trees, places, strict=True)]
    return (
        np.concatenate([struct_zeros(Node, 0), *nodes]),
        np.concatenate([struct_zeros(TriangleBlock, 0), *(tree.blocks for tree in trees)]),
        np.concatenate([struct_zeros(Patch, 0), *(tree.patches for tree in trees)]),
        places,
    )


def boxes_of(trees: Sequence[TriangleTree]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Centre and half size (n, 3) [m] of boxes that hold all triangles of each tree."""
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
        """Shapes of these kinds, TRIANGLES or SHEET, each of the tree with this index."""
        index = np.array(tree, np.int32)
        center, half = (ends[index] for ends in boxes_of(trees))
        return Shapes(np.array(kind, np.int32), np.zeros_like(center), index, center, half)

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
