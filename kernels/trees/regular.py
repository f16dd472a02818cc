"""Trees over boxes in rows and columns, built bottom-up with the same regularity.

A node has eight children: two by four, four by two, or of one row or column, so that its box is close to a square. At
the ends of rows and columns it has fewer.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .nodes import NO_CHILD, OUTWARDS, empty_nodes

_FANS = ((1, 8), (2, 4), (4, 2), (8, 1))
"""Possible (rows, columns) of the children of a node."""


class BoxGrid(NamedTuple):
    """Boxes in rows and columns: their ends (rows, columns, 3), and the node or ~leaf in each (rows, columns)."""

    lower: npt.NDArray[np.float32]
    upper: npt.NDArray[np.float32]
    child: npt.NDArray[np.int32]

    @staticmethod
    def in_one_row(parts: "Sequence[BoxGrid]") -> "BoxGrid":
        """All boxes of the parts, one after the other, as a single row."""
        lower, upper = (
            np.concatenate([getattr(part, end).reshape(1, -1, 3) for part in parts], axis=1)
            for end in ("lower", "upper")
        )
        return BoxGrid(lower, upper, np.concatenate([part.child.reshape(1, -1) for part in parts], axis=1))


class RegularNodes:
    """The nodes of a tree under construction, numbered in the order in which they are made, until `from_last`."""

    def __init__(self) -> None:
        self._made: list[npt.NDArray[np.void]] = []
        self._count = 0

    def over(self, boxes: BoxGrid) -> BoxGrid:
        """Make the nodes over these boxes; return the boxes of the nodes."""
        fan = _fan(boxes)
        lower, upper = _members(boxes.lower, fan, np.inf), _members(boxes.upper, fan, -np.inf)
        child = _members(boxes.child, fan, NO_CHILD)
        with np.errstate(invalid="ignore"):  # inf - inf of absent children
            middle = 0.5 * lower + 0.5 * upper
            half = np.maximum(upper - middle, middle - lower) * np.float32(OUTWARDS)
        absent = child == NO_CHILD
        middle[absent], half[absent] = 0.0, -np.inf
        nodes = empty_nodes(child[0].size)
        for j in range(len(child)):
            for k, axis in enumerate("xyz"):
                nodes[f"center_{axis}"][:, j] = middle[j, ..., k].ravel()
                nodes[f"half_{axis}"][:, j] = half[j, ..., k].ravel()
            nodes["child"][:, j] = child[j].ravel()
        number = np.arange(self._count, self._count + len(nodes), dtype=np.int32).reshape(child.shape[1:])
        self._made.append(nodes)
        self._count += len(nodes)
        return BoxGrid(lower.min(axis=0), upper.max(axis=0), number)

    def raised(self, boxes: BoxGrid, most: int) -> BoxGrid:
        """Make level after level of nodes over these boxes, until a level has at most `most`; return its boxes."""
        while boxes.child.size > most:
            boxes = self.over(boxes)
        return boxes

    def from_last(self) -> npt.NDArray[np.void]:
        """All nodes, renumbered with the last one first, so that children come after their parents."""
        nodes = np.concatenate(self._made)[::-1].copy()
        child = nodes["child"]
        nodes["child"] = np.where(child >= 0, self._count - 1 - child, child)
        return nodes


def _fan(boxes: BoxGrid) -> tuple[int, int]:
    """Rows and columns of boxes per node: as many boxes as possible, then as close to a square as possible."""
    rows, columns = boxes.child.shape
    width, depth = (boxes.upper.max(axis=(0, 1)) - boxes.lower.min(axis=(0, 1)))[:2] / (columns, rows)

    def worth(fan: tuple[int, int]) -> tuple[int, float]:
        own = min(fan[0], rows), min(fan[1], columns)
        return own[0] * own[1], -(own[0] * depth + own[1] * width)

    return max(_FANS, key=worth)


def _members(values: npt.NDArray[Any], fan: tuple[int, int], nothing: float) -> npt.NDArray[Any]:
    """Group (r, c, ...) into (children, R, C, ...): entry [j] holds child j of every node; padded with `nothing`."""
    rows, columns = fan
    fill = [(0, -n % own) for n, own in zip(values.shape, fan, strict=False)]
    whole = np.pad(values, fill + [(0, 0)] * (values.ndim - 2), constant_values=nothing)
    return np.stack([whole[i::rows, j::columns] for i in range(rows) for j in range(columns)])
