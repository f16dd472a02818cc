"""Trees over height fields: a regular tree over plots of the surface, and rows of triangles for sides and bottom."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import FARTHEST, NO_FACE, Plot, TriangleBlock
from rigcast.kernels.shapes.patches import COLUMNS, ROWS
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, OUTWARDS, WIDTH, struct_zeros
from rigcast.kernels.trees.regular import BoxGrid, RegularNodes

from .arrays import TriangleTree
from .triangle_tree import fill, lend

Floats = npt.NDArray[np.float32]

MOST_ROWS = 5
"""Most rows of triangles. Each takes one child of the root, whose other children are nodes of the surface."""


def build_height_field(
    x: npt.ArrayLike, y: npt.ArrayLike, heights: npt.ArrayLike, others: Sequence[npt.NDArray[np.floating]]
) -> TriangleTree:
    """Build a tree over a surface of cells, each split along the diagonal from lower x and y to higher x and y.

    Args:
        x, y: (columns,) and (rows,) coordinates of the cells' corners [m], ascending, at least two each.
        heights: (rows, columns) [m].
        others: 1 to MOST_ROWS rows of triangles (n, 3, 3) [m]; consecutive triangles of a row are neighbours.
            Triangles without area are never hit. No coordinate may exceed FARTHEST; this is not checked.

    Returns:
        A tree. Faces 2 k and 2 k + 1 are cell k, row by row, below and above its diagonal; those of `others` follow.

    Raises:
        ValueError: a corner that is not finite or too large, or too many corners.
    """
    with np.errstate(over="ignore"):  # values that become infinite are refused below
        x, y, heights = (np.asarray(a, np.float32) for a in (x, y, heights))
    _require_usable(x, y, heights)
    cells = (len(y) - 1, len(x) - 1)
    surface = _Corners.of(x, y, heights)
    blocks, rows = _blocks(others, 2 * cells[0] * cells[1])
    nodes = RegularNodes()
    tops = [nodes.raised(surface.boxes(), WIDTH - MOST_ROWS), *(nodes.raised(row, 1) for row in rows)]
    root = nodes.over(BoxGrid.in_one_row(tops))
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
    """The corners of cells, padded to whole plots as described in rigcast.kernels.shapes.patches."""

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
        """The plots (n,) of Plot, row by row. columns: cells per row of the field."""
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
        """The array Geometry.sides: entries of all columns of plots, then of all rows; see Plot."""
        return np.concatenate([sides.ravel() for sides in self._sides()])

    def _sides(self) -> tuple[Floats, Floats]:
        """Entries of `sides` per column of plots (n, 17) and per row of plots (m, 21)."""
        across, along = _side(self.x, COLUMNS), _side(self.y, ROWS)
        return np.concatenate(across, axis=1), np.concatenate([along[0], *np.repeat(along[1:], 4, axis=2)], axis=1)

    def boxes(self) -> BoxGrid:
        """The boxes of the plots."""
        lower, upper = (self._ends(end) for end in (np.fmin, np.fmax))
        number = np.arange(lower[..., 0].size, dtype=np.int32).reshape(lower.shape[:2])
        return BoxGrid(lower, upper, ~(FIRST_PLOT + number))

    def _ends(self, end: np.ufunc) -> Floats:
        """The lower or upper ends (rows, columns, 3) of the boxes of the plots."""
        x, y = _over(end, self.x, COLUMNS), _over(end, self.y, ROWS)
        z = _over(end, _over(end, self.z, ROWS).T, COLUMNS).T
        return np.stack([*np.meshgrid(x, y, copy=False), z], axis=-1)


def _side(corners: Floats, cells: int) -> tuple[Floats, Floats, Floats]:
    """Per plot along one axis: corners (n, cells + 1), centres and half sizes (n, cells / 2) of its patches' boxes."""
    windows = np.lib.stride_tricks.sliding_window_view(corners, cells + 1)[::cells]
    low, middle, high = windows[:, 0:-1:2], windows[:, 1::2], windows[:, 2::2]
    high = np.where(np.isnan(high), middle, high)
    center = np.float32(0.5) * low + np.float32(0.5) * high
    half = np.maximum(high - center, center - low) * np.float32(OUTWARDS)
    absent = np.isnan(middle)
    return windows, np.where(absent, np.float32(0), center), np.where(absent, np.float32(-np.inf), half)


def _over(end: np.ufunc, values: Floats, step: int) -> Floats:
    """The least or largest value in the windows [0, step], [step, 2 step], ... along the first axis, ends included."""
    runs = values[:-1].reshape(-1, step, *values.shape[1:])
    found: Floats = end(end.reduce(runs, axis=1), values[step::step])
    return found


def _blocks(rows: Sequence[npt.NDArray[np.floating]], first_face: int) -> tuple[npt.NDArray[np.void], list[BoxGrid]]:
    """Blocks of rows of triangles, and the boxes of each row's blocks. Faces are numbered from first_face on."""
    corners = np.concatenate(rows).astype(np.float32).reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    own = np.split(np.arange(len(faces), dtype=np.int32), np.cumsum([*map(len, rows)])[:-1])
    filled = [np.pad(row, (0, -len(row) % WIDTH), constant_values=NO_FACE).reshape(-1, WIDTH) for row in own]
    face = np.concatenate(filled)
    blocks = struct_zeros(TriangleBlock, len(face))
    blocks["face"] = face
    lower, upper = fill(lend(blocks, TriangleBlock), lend(corners, wp.vec3), lend(faces, wp.vec3i))
    blocks["face"] = np.where(face == NO_FACE, NO_FACE, face + first_face)
    number = ~np.arange(len(blocks), dtype=np.int32)
    ends = np.cumsum([*map(len, filled)])
    return blocks, [
        BoxGrid(lower[None, first:end], upper[None, first:end], number[None, first:end])
        for first, end in zip([0, *ends[:-1]], ends, strict=True)
    ]
