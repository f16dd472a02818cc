"""Access to single triangles of blocks and patches by their number: leaf * WIDTH + lane."""

from collections.abc import Callable
from typing import Any

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.trees.nodes import FIRST_PATCH, WIDTH
from rigcast.kernels.vectors import to_double, to_float

FIRST_IN_PATCHES = wp.constant(FIRST_PATCH * WIDTH)


@wp.struct
class Triangle:
    a: wp.vec3
    b: wp.vec3
    c: wp.vec3


@wp.struct
class Facet:
    """A triangle's plane and face, in its shape's frame.

    corner: one of its corners. normal: the winding normal, of any length. scale: 1 / that length. The distance to the
    plane does not depend on the length, so its computation need not wait for it.
    """

    corner: wp.vec3
    normal: wp.vec3d
    scale: wp.float64
    face: int


@wp.func
def area_normal(triangle: Triangle) -> wp.vec3d:
    """The winding normal; its length is twice the area."""
    a = to_double(triangle.a)
    return wp.cross(to_double(triangle.b) - a, to_double(triangle.c) - a)


@wp.func
def unit_normal(triangle: Triangle) -> wp.vec3:
    """The unit winding normal; NaN for a triangle without area."""
    n = area_normal(triangle)
    area = wp.length(n)
    if area > wp.float64(0.0):
        return to_float(n / area)
    return wp.vec3(wp.nan, wp.nan, wp.nan)


@wp.func
def triangle_at(g: wp.array[Geometry], number: int) -> Triangle:
    triangle = Triangle()
    if number >= FIRST_IN_PATCHES:
        triangle = triangle_of_patch(g, number - FIRST_IN_PATCHES)
    else:
        triangle = triangle_of_block(g[0].blocks, number)
    return triangle


@wp.func_native("return (&wp::address(blocks, k)->x0[0])[i];")
def number_of_block(blocks: wp.array[TriangleBlock], k: int, i: int) -> float:  # type: ignore[empty-body]
    """Number i of a block's 96 (eight of each field), read alone; Warp would copy all eight first."""


@wp.func_native("return wp::address(blocks, k)->face[j];")
def face_of_block(blocks: wp.array[TriangleBlock], k: int, j: int) -> int:  # type: ignore[empty-body]
    """The number of a triangle's face, read alone."""


@wp.func
def vector_of_block(blocks: wp.array[TriangleBlock], number: int, which: int) -> wp.vec3:
    """Vector `which` of a triangle: corner 0, 1 or 2, or 3 for its normal."""
    k = number / WIDTH
    i = 3 * WIDTH * which + number % WIDTH
    return wp.vec3(
        number_of_block(blocks, k, i),
        number_of_block(blocks, k, i + WIDTH),
        number_of_block(blocks, k, i + 2 * WIDTH),
    )


@wp.func
def triangle_of_block(blocks: wp.array[TriangleBlock], number: int) -> Triangle:
    triangle = Triangle()
    triangle.a = vector_of_block(blocks, number, 0)
    triangle.b = vector_of_block(blocks, number, 1)
    triangle.c = vector_of_block(blocks, number, 2)
    return triangle


@wp.func
def normal_of_block(blocks: wp.array[TriangleBlock], number: int) -> wp.vec3:
    return vector_of_block(blocks, number, 3)


@wp.func
def facet_at(g: wp.array[Geometry], entry: int, number: int) -> Facet:
    """The Facet of a triangle. entry: index of its shape in arrays of sizes."""
    facet = Facet()
    if number >= FIRST_IN_PATCHES:
        facet = facet_of_patch(g, number - FIRST_IN_PATCHES, g[0].columns[entry])
    else:
        facet.corner = vector_of_block(g[0].blocks, number, 0)
        facet.normal = to_double(normal_of_block(g[0].blocks, number))
        facet.scale = wp.float64(1.0)
        facet.face = face_of_block(g[0].blocks, number / WIDTH, number % WIDTH)
    return facet


def _in_patch(on_cuda: str, on_cpu: str) -> str:
    """C++ that reads one number of patch k."""
    return f"""
    const auto& geometry = g.data[0];
#if defined(__CUDA_ARCH__)
    return geometry.patches.data[k].{on_cuda};
#else
    const auto& plot = geometry.plots.data[k >> 3];
    return {on_cpu};
#endif
"""


@wp.func_native(_in_patch("x[column]", "geometry.sides.data[plot.x + 2 * (k & 3) + column]"))
def x_of(g: wp.array[Geometry], k: int, column: int) -> float:  # type: ignore[empty-body]
    """The x coordinate [m] of a column of corners of patch k."""


@wp.func_native(_in_patch("y[row]", "geometry.sides.data[plot.y + 2 * (k >> 2 & 1) + row]"))
def y_of(g: wp.array[Geometry], k: int, row: int) -> float:  # type: ignore[empty-body]
    """The y coordinate [m] of a row of corners of patch k."""


@wp.func_native(_in_patch("z.data[row][column]", "plot.z.data[2 * (k >> 2 & 1) + row][2 * (k & 3) + column]"))
def z_of(g: wp.array[Geometry], k: int, row: int, column: int) -> float:  # type: ignore[empty-body]
    """The height [m] of a corner of patch k."""


@wp.func_native(_in_patch("face", "plot.face"))
def first_face_of(g: wp.array[Geometry], k: int) -> int:  # type: ignore[empty-body]
    """Number of the lower face of the first cell of the patch's plot."""


@wp.func
def corner_of(g: wp.array[Geometry], k: int, row: int, column: int) -> wp.vec3:
    return wp.vec3(x_of(g, k, column), y_of(g, k, row), z_of(g, k, row, column))


def triangle_of_patches(name: str, kept: Any, corner: Callable[..., Any]) -> Any:
    """A Warp function that makes a triangle of a patch from its number; see rigcast.kernels.shapes.patches.

    Args:
        kept: the type that holds the patches.
        corner: (kept, patch, row, column) -> vec3.
    """

    def triangle_of(patches: kept, number: int) -> Triangle:
        k = number / WIDTH
        row = number / 2 % 2
        column = number % 2
        triangle = Triangle()
        triangle.a = corner(patches, k, row, column)
        triangle.b = corner(patches, k, row, column + 1)
        triangle.c = corner(patches, k, row + 1, column + 1)
        if number % WIDTH >= WIDTH / 2:
            triangle.b = triangle.c
            triangle.c = corner(patches, k, row + 1, column)
        return triangle

    triangle_of.__name__ = triangle_of.__qualname__ = name
    return wp.func(triangle_of)


triangle_of_patch = triangle_of_patches("triangle_of_patch", wp.array[Geometry], corner_of)


@wp.func
def facet_of_patch(g: wp.array[Geometry], number: int, columns: int) -> Facet:
    """The Facet of a triangle of a patch. columns: cells per row of the height field.

    The normal of a triangle that rises by a over dx along x and by b over dy along y is (-a dy, -b dx, dx dy).
    """
    k = number >> 3
    column = number & 1
    row = (number >> 1) & 1
    upper = (number >> 2) & 1
    x = x_of(g, k, column)
    y = y_of(g, k, row)
    z = z_of(g, k, row, column)
    z_far = wp.float64(z_of(g, k, row + 1, column + 1))
    z_third = wp.float64(z_of(g, k, row + upper, column + 1 - upper))
    dx = wp.float64(x_of(g, k, column + 1)) - wp.float64(x)
    dy = wp.float64(y_of(g, k, row + 1)) - wp.float64(y)
    early = z_third - wp.float64(z)
    late = z_far - z_third
    a = wp.where(upper == 0, early, late)
    b = wp.where(upper == 0, late, early)
    facet = Facet()
    facet.corner = wp.vec3(x, y, z)
    facet.normal = wp.vec3d(-a * dy, -b * dx, dx * dy)
    facet.scale = wp.float64(1.0) / wp.length(facet.normal)
    cell = (2 * ((k >> 2) & 1) + row) * columns + 2 * (k & 3) + column
    facet.face = first_face_of(g, k) + 2 * cell + upper
    return facet
