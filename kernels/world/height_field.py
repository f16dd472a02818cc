"""Trees over height fields: plots of the surface in a regular tree, and rows of triangles beside and below it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import FARTHEST, NO_FACE, Plot, TriangleBlock
from rigcast.kernels.shapes.patches import COLUMNS, ROWS
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, OUTWARDS, WIDTH, struct_zeros
from rigcast.kernels.trees.regular import Boxes, RegularNodes

from .arrays import TriangleTree
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
        plots=surface.plots(cells[1]),
        sides=surface.sides(),
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
    """The corners of whole plots; rigcast.kernels.shapes.patches says what those have that are not there."""

    x: Floats
    y: Floats
    z: Floats

    @staticmethod
    def of(x: Floats, y: Floats, heights: Floats) -> "_Corners":
        rows, columns = (1 - len(y)) % ROWS, (1 - len(x)) % COLUMNS
        return _Corners(
            np.pad(x, (0, columns), constant_values=np.nan),
            np.pad(y, (0, rows), constant_values=np.nan),
            np.pad(heights, [(0, rows), (0, columns)], mode="edge"),
        )

    def plots(self, columns: int) -> npt.NDArray[np.void]:
        """(n,) of Plot, row by row; columns: the cells of a row."""
        windows = np.lib.stride_tricks.sliding_window_view(self.z, (ROWS + 1, COLUMNS + 1))[::ROWS, ::COLUMNS]
        row, column = np.arange(len(windows))[:, None], np.arange(windows.shape[1])
        plots = struct_zeros(Plot, windows.shape[0] * windows.shape[1])
        grid = plots.reshape(windows.shape[:2])
        grid["z"] = windows
        across, along = self._sides()
        grid["x"], grid["y"] = across.shape[1] * column, across.size + along.shape[1] * row
        grid["face"] = 2 * (columns * ROWS * row + COLUMNS * column)
        return plots

    def sides(self) -> Floats:
        """Of all columns of plots, then of all rows, as Plot says."""
        return np.concatenate([sides.ravel() for sides in self._sides()])

    def _sides(self) -> tuple[Floats, Floats]:
        """Of the columns (n, 17) and of the rows (m, 21)."""
        across, along = _side(self.x, COLUMNS), _side(self.y, ROWS)
        return np.concatenate(across, axis=1), np.concatenate([along[0], *np.repeat(along[1:], 4, axis=2)], axis=1)

    def boxes(self) -> Boxes:
        """Those of the plots."""
        lower, upper = (self._ends(end) for end in (np.fmin, np.fmax))
        number = np.arange(lower[..., 0].size, dtype=np.int32).reshape(lower.shape[:2])
        return Boxes(lower, upper, ~(FIRST_PLOT + number))

    def _ends(self, end: np.ufunc) -> Floats:
        """The lower or upper ends (rows, columns, 3) of the plots."""
        x, y = _over(end, self.x, COLUMNS), _over(end, self.y, ROWS)
        z = _over(end, _over(end, self.z, ROWS).T, COLUMNS).T
        return np.stack([*np.meshgrid(x, y, copy=False), z], axis=-1)


def _side(corners: Floats, cells: int) -> tuple[Floats, Floats, Floats]:
    """Of each plot its corners (n, cells + 1), and centre and half size (n, cells / 2) of the boxes of patches."""
    windows = np.lib.stride_tricks.sliding_window_view(corners, cells + 1)[::cells]
    low, middle, high = windows[:, 0:-1:2], windows[:, 1::2], windows[:, 2::2]
    high = np.where(np.isnan(high), middle, high)
    center = np.float32(0.5) * low + np.float32(0.5) * high
    half = np.maximum(high - center, center - low) * np.float32(OUTWARDS)
    absent = np.isnan(middle)
    return windows, np.where(absent, np.float32(0), center), np.where(absent, np.float32(-np.inf), half)


def _over(end: np.ufunc, values: Floats, step: int) -> Floats:
    """The least or the largest of numbers 0 to step, step to 2 step, ... along the first axis."""
    runs = values[:-1].reshape(-1, step, *values.shape[1:])
    found: Floats = end(end.reduce(runs, axis=1), values[step::step])
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
