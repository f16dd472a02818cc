"""Trees over height fields: patches of the surface in a regular tree, and rows of triangles beside and below it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import FARTHEST, NO_FACE, Patch, TriangleBlock, TriangleTree

from .nodes import FIRST_PATCH, WIDTH, struct_zeros
from .regular import Boxes, RegularNodes
from .triangle_tree import fill, on_cpu

Floats = npt.NDArray[np.float32]

MOST_ROWS = 5
"""Of triangles, which are children of the root, as are the nodes of the surface: eight in all."""


def build_height_field(
    x: npt.ArrayLike, y: npt.ArrayLike, heights: npt.ArrayLike, others: Sequence[npt.NDArray[np.floating]]
) -> TriangleTree:
    """Build a tree over a surface of cells, each split from its corner of lower x and y to that of higher ones.

    Args:
        x, y: (columns,) and (rows,) where corners of cells are [m], in rising order, at least two each.
        heights: (rows, columns) [m].
        others: up to MOST_ROWS rows of triangles (n, 3, 3) [m], each beside the one before. One without area is never
            hit. Nothing is farther from 0 than FARTHEST.

    Returns:
        A tree whose faces 2 k and 2 k + 1 are cell k, row by row, below and above its diagonal; the others follow.

    Raises:
        ValueError: a corner that is not finite or too large, or too many of them.
    """
    with np.errstate(over="ignore"):  # what becomes infinite is refused
        x, y, heights = (np.asarray(a, np.float32) for a in (x, y, heights))
    _require_usable(x, y, heights)
    cells = (len(y) - 1, len(x) - 1)
    surface = _Corners.of(x, y, heights)
    blocks, rows = _blocks(others, 2 * cells[0] * cells[1])
    nodes = RegularNodes()
    tops = [nodes.raised(surface.boxes(), WIDTH - MOST_ROWS), *(nodes.raised(row, 1) for row in rows)]
    root = nodes.over(Boxes.in_one_row(tops))
    return TriangleTree(
        nodes.from_last(),
        blocks,
        root.lower[0, 0],
        root.upper[0, 0],
        dropped=0,
        patches=surface.patches(cells[1]),
        columns=cells[1],
    )


def _require_usable(x: Floats, y: Floats, heights: Floats) -> None:
    most = 4 * FIRST_PATCH
    if heights.size > most:
        raise ValueError(f"got {len(y)} x {len(x)} heights, expected up to {most}")
    bad = ~(np.abs(heights) <= FARTHEST) | ~(np.abs(x) <= FARTHEST) | ~(np.abs(y) <= FARTHEST)[:, None]
    if bad.any():
        row, column = np.argwhere(bad)[0]
        got = [float(x[column]), float(y[row]), float(heights[row, column])]
        raise ValueError(f"row {row}, column {column}: got {got}, expected finite numbers up to {FARTHEST:g} m")


class _Corners(NamedTuple):
    """The corners of an even number of rows and columns of cells; Patch says what those have that are not there."""

    x: Floats
    y: Floats
    z: Floats

    @staticmethod
    def of(x: Floats, y: Floats, heights: Floats) -> "_Corners":
        rows, columns = 1 - len(y) % 2, 1 - len(x) % 2
        return _Corners(
            np.pad(x, (0, columns), constant_values=np.nan),
            np.pad(y, (0, rows), constant_values=np.nan),
            np.pad(heights, [(0, rows), (0, columns)], mode="edge"),
        )

    def patches(self, columns: int) -> npt.NDArray[np.void]:
        """(n,) of Patch, row by row; columns: the cells of a row."""
        x, y = _threes(self.x, 0), _threes(self.y, 0)
        patches = struct_zeros(Patch, len(x) * len(y))
        grid = patches.reshape(len(y), len(x))
        grid["x"], grid["y"], grid["z"] = x, y[:, None], _threes(_threes(self.z, 0), 1)
        grid["face"] = 4 * (columns * np.arange(len(y))[:, None] + np.arange(len(x)))
        return patches

    def boxes(self) -> Boxes:
        """Those of the patches."""
        lower, upper = (self._ends(end) for end in (np.fmin, np.fmax))
        number = np.arange(lower[..., 0].size, dtype=np.int32).reshape(lower.shape[:2])
        return Boxes(lower, upper, ~(FIRST_PATCH + number))

    def _ends(self, end: np.ufunc) -> Floats:
        """The lower or upper ends (rows, columns, 3) of the patches."""
        x, y = _over_threes(end, self.x), _over_threes(end, self.y)
        z = _over_threes(end, _over_threes(end, self.z).T).T
        return np.stack([*np.meshgrid(x, y, copy=False), z], axis=-1)


def _threes(values: Floats, axis: int) -> Floats:
    """A view of numbers 0 to 2, 2 to 4, 4 to 6, ... along an axis, along a last axis of three."""
    return np.lib.stride_tricks.sliding_window_view(values, 3, axis)[(slice(None),) * axis + (slice(None, None, 2),)]


def _over_threes(end: np.ufunc, values: Floats) -> Floats:
    """The least or the largest of numbers 0 to 2, 2 to 4, 4 to 6, ... along the first axis."""
    found: Floats = end(end(values[:-2:2], values[1::2]), values[2::2])
    return found


def _blocks(rows: Sequence[npt.NDArray[np.floating]], first_face: int) -> tuple[npt.NDArray[np.void], list[Boxes]]:
    """(blocks,) of TriangleBlock, and the boxes of those of each row of triangles, whose faces are numbered on."""
    corners = np.concatenate(rows).astype(np.float32).reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    own = np.split(np.arange(len(faces), dtype=np.int32), np.cumsum([*map(len, rows)])[:-1])
    filled = [np.pad(row, (0, -len(row) % WIDTH), constant_values=NO_FACE).reshape(-1, WIDTH) for row in own]
    face = np.concatenate(filled)
    blocks = struct_zeros(TriangleBlock, len(face))
    blocks["face"] = face
    lower, upper = fill(on_cpu(blocks, TriangleBlock), on_cpu(corners, wp.vec3), on_cpu(faces, wp.vec3i))
    blocks["face"] = np.where(face == NO_FACE, NO_FACE, face + first_face)
    number = ~np.arange(len(blocks), dtype=np.int32)
    ends = np.cumsum([*map(len, filled)])
    return blocks, [
        Boxes(lower[None, first:end], upper[None, first:end], number[None, first:end])
        for first, end in zip([0, *ends[:-1]], ends, strict=True)
    ]
