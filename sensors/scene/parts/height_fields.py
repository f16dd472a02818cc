"""MuJoCo's height fields as mj_ray sees them: the surface, four sides down to z = 0, and a whole box below."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.world.arrays import TriangleTree
from rigcast.kernels.world.height_field import build_height_field

Doubles = NDArray[np.float64]
Size = Doubles
"""(4,) half size along x, half size along y, height of data 1, depth of the base [m]."""


def hfield_data(model: mujoco.MjModel, hfield: int) -> NDArray[np.float32]:
    """The elevations (rows, columns) of a height field, a view of the model's."""
    rows, columns = model.hfield_nrow[hfield], model.hfield_ncol[hfield]
    first = model.hfield_adr[hfield]
    return model.hfield_data[first : first + rows * columns].reshape(rows, columns)


def hfield_tree(size: Size, data: NDArray[np.float32]) -> TriangleTree:
    """The tree over the triangles of `hfield_triangles`.

    Raises ValueError for a size or an elevation that is not finite or too large, and a surface without width or depth.
    """
    if not ((np.abs(size) <= FARTHEST).all() and (size[:2] > 0).all()):
        raise ValueError(f"size: got {size.tolist()}, expected up to {FARTHEST:g} m, and half sizes above 0 m")
    x, y, z = _surface(size, data)
    return build_height_field(x, y, z, [*_sides(x, y, z), _base(size)])


def hfield_triangles(size: Size, data: NDArray[np.float32]) -> tuple[Doubles, NDArray[np.int32]]:
    """All triangles of a height field.

    Args:
        data: (rows along y, columns along x), 0 to 1.

    Returns:
        Vertices (n, 3) [m] and faces (m, 3), counter-clockwise from outside. Faces 2 k and 2 k + 1 are cell k,
        row by row, split along v(r, c) - v(r + 1, c + 1); the sides and the box follow.
    """
    x, y, z = _surface(size, data)
    index = np.arange(z.size, dtype=np.int32).reshape(z.shape)
    v00, v01, v10, v11 = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    cells = np.stack([v00, v01, v11, v00, v11, v10], axis=-1).reshape(-1, 3)
    others = np.concatenate([*_sides(x, y, z), _base(size)]).reshape(-1, 3)
    vertices = np.concatenate([np.stack([*np.meshgrid(x, y), z], axis=-1).reshape(-1, 3), others])
    return vertices, np.concatenate([cells, np.arange(z.size, len(vertices), dtype=np.int32).reshape(-1, 3)])


def _surface(size: Size, data: NDArray[np.float32]) -> tuple[Doubles, Doubles, Doubles]:
    """Coordinates [m] of the cells' corners: x (columns,), y (rows,), z (rows, columns)."""
    rows, columns = data.shape
    return (
        np.linspace(-size[0], size[0], columns),
        np.linspace(-size[1], size[1], rows),
        size[2] * data.astype(np.float64),
    )


def _sides(x: Doubles, y: Doubles, z: Doubles) -> list[Doubles]:
    """Corners (n, 3, 3) of the triangles between each border of the surface and z = 0, once around."""
    surface = np.stack([*np.meshgrid(x, y, copy=False), z], axis=-1)
    borders = surface[0], surface[:, -1], surface[-1, ::-1], surface[::-1, 0]
    return [_wall(border) for border in borders]


def _wall(top: Doubles) -> Doubles:
    foot = np.pad(top[:, :2], [(0, 0), (0, 1)])
    lower, upper = (foot[:-1], foot[1:], top[1:]), (foot[:-1], top[1:], top[:-1])
    return np.stack([np.stack(lower, axis=1), np.stack(upper, axis=1)], axis=1).reshape(-1, 3, 3)


def _base(size: Size) -> Doubles:
    """Corners (12, 3, 3) of the box below: |x| <= size 0, |y| <= size 1, -size 3 <= z <= 0."""
    low, high = np.array([-size[0], -size[1], -size[3]]), np.array([size[0], size[1], 0.0])
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (3, 2, 6, 7), (2, 0, 4, 6), (1, 3, 7, 5)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    return np.where(corners == 1, high, low)[faces]
