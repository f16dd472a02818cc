"""Trees over triangles. The assignment of faces to blocks is fixed by the build; a kernel fills in corners and normals.

The same kernel runs again when vertices move.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import FARTHEST, NO_FACE, TriangleBlock
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.shapes.facets import Triangle, area_normal, unit_normal
from rigcast.kernels.trees.boxes import empty_box, join
from rigcast.kernels.trees.nodes import WIDTH
from rigcast.kernels.trees.tree import Tree, build_tree

from .arrays import TriangleTree

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

Floats = npt.NDArray[np.float32]


@wp.func
def triangle_of(vertices: wp.array[wp.vec3], corners: wp.vec3i) -> Triangle:
    triangle = Triangle()
    triangle.a = vertices[corners[0]]
    triangle.b = vertices[corners[1]]
    triangle.c = vertices[corners[2]]
    return triangle


@wp.kernel
def measure_faces(
    first_face: int,
    vertices: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    # out:
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    has_area: wp.array[wp.bool],
) -> None:
    """Write the box of each face, and whether it has an area."""
    i = first_face + wp.tid()
    triangle = triangle_of(vertices, faces[i])
    lower[i] = wp.min(wp.min(triangle.a, triangle.b), triangle.c)
    upper[i] = wp.max(wp.max(triangle.a, triangle.b), triangle.c)
    has_area[i] = wp.length(area_normal(triangle)) > wp.float64(0.0)


@wp.kernel
def fill_blocks(
    first_block: int,
    vertices: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    # in: which faces, out: their corners and normals
    blocks: wp.array[TriangleBlock],
    # out, one per block:
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
) -> None:
    """Fill in corners and normals of each block's faces, and write its box.

    A triangle without area gets a normal of NaN and is never hit.
    """
    i = first_block + wp.tid()
    block = blocks[i]
    box = empty_box()
    nowhere = wp.vec3(wp.nan, wp.nan, wp.nan)
    for j in range(WIDTH):
        triangle = Triangle()
        triangle.a = nowhere
        triangle.b = nowhere
        triangle.c = nowhere
        normal = nowhere
        if block.face[j] != NO_FACE:
            triangle = triangle_of(vertices, faces[block.face[j]])
            box = join(join(join(box, triangle.a, triangle.a), triangle.b, triangle.b), triangle.c, triangle.c)
            normal = unit_normal(triangle)
        block.x0[j] = triangle.a[0]
        block.y0[j] = triangle.a[1]
        block.z0[j] = triangle.a[2]
        block.x1[j] = triangle.b[0]
        block.y1[j] = triangle.b[1]
        block.z1[j] = triangle.b[2]
        block.x2[j] = triangle.c[0]
        block.y2[j] = triangle.c[1]
        block.z2[j] = triangle.c[2]
        block.normal_x[j] = normal[0]
        block.normal_y[j] = normal[1]
        block.normal_z[j] = normal[2]
    blocks[i] = block
    lower[i] = box.lower
    upper[i] = box.upper


def build_triangle_tree(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> TriangleTree:
    """Build a tree over triangles.

    Args:
        vertices: (n, 3) float32 [m], up to FARTHEST in size.
        faces: (m, 3) indices into vertices, counter-clockwise seen from outside. Faces without area are dropped.

    Raises:
        ValueError: a face with an index out of range, or with a vertex that is not finite or too large.
    """
    v, f = np.asarray(vertices), np.asarray(faces).reshape(-1, 3)
    _require_usable(v, f)
    with np.errstate(over="ignore"):  # vertices that are in no face may overflow
        places = lend(v.astype(np.float32, copy=False), wp.vec3)
    corners = lend(f.astype(np.int32, copy=False), wp.vec3i)
    lower, upper, has_area = _measured(places, corners)
    face = np.flatnonzero(has_area)
    kept = slice(None) if len(face) == len(f) else face  # avoids a copy if all are kept
    tree = build_tree(lower[kept], upper[kept], leaf_size=WIDTH)
    blocks = blocks_of(tree, face)
    box = whole_box(*fill(lend(blocks, TriangleBlock), places, corners))
    return TriangleTree(tree.nodes, blocks, *box, dropped=len(f) - len(face))


def require_in_range(faces: npt.NDArray[np.integer], count: int) -> None:
    """Raise ValueError for faces (m, 3) that are not of vertices 0 to count - 1."""
    out_of_range = (faces < 0) | (faces >= count)
    if out_of_range.any():
        face, corner = np.argwhere(out_of_range)[0]
        raise ValueError(f"face {face}: got vertex {faces[face, corner]}, expected 0 to {count - 1}")


def _require_usable(vertices: npt.NDArray[Any], faces: npt.NDArray[np.integer]) -> None:
    require_in_range(faces, len(vertices))
    bad = ~(np.abs(vertices) <= FARTHEST).all(axis=-1)
    if bad.any() and bad[faces].any():
        face, corner = np.argwhere(bad[faces])[0]
        vertex = faces[face, corner]
        got = vertices[vertex].tolist()
        raise ValueError(f"face {face}: vertex {vertex}: got {got}, expected finite numbers up to {FARTHEST:g} m")


def _measured(places: wp.array, corners: wp.array) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
    """The lower and upper ends (faces, 3) of the box of each face, and whether it has an area."""
    lower, upper = (wp.empty(corners.size, dtype=wp.vec3, device="cpu") for _ in range(2))
    has_area = wp.empty(corners.size, dtype=wp.bool, device="cpu")
    launch_over_rays(measure_faces, corners.size, [places, corners], [lower, upper, has_area], "cpu")
    return lower.numpy(), upper.numpy(), has_area.numpy()


def blocks_of(tree: Tree, face: npt.NDArray[np.integer]) -> npt.NDArray[np.void]:
    """Blocks (leaves,) of TriangleBlock with face numbers only; box k of the tree is that of face[k]."""
    lane = np.arange(WIDTH)
    is_absent = lane >= tree.leaf_count[:, None]
    dtype: np.dtype[np.void] = TriangleBlock.numpy_dtype()
    blocks = np.empty(len(is_absent), dtype)
    if len(face):
        box = tree.order[np.where(is_absent, 0, tree.leaf_first[:, None] + lane)]
        blocks["face"] = np.where(is_absent, NO_FACE, face[box])
    return blocks


def fill(blocks: wp.array, places: wp.array, corners: wp.array) -> list[Floats]:
    """Fill in corners and normals of the blocks' faces; return the blocks' boxes, lower and upper ends (blocks, 3)."""
    boxes = [wp.empty(blocks.size, dtype=wp.vec3, device="cpu") for _ in range(2)]
    launch_over_rays(fill_blocks, blocks.size, [places, corners], [blocks, *boxes], "cpu")
    return [ends.numpy() for ends in boxes]


def whole_box(lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """The lower and upper end (3,) of the box around all boxes (n, 3); a point at the origin if there are none."""
    if not len(lower):
        return np.zeros(3, np.float32), np.zeros(3, np.float32)
    return lower.min(axis=0), upper.max(axis=0)


def lend(values: npt.NDArray[Any], dtype: Any) -> wp.array:
    """An array on the CPU that shares the memory of the values, if they are contiguous."""
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu", copy=False)
