"""Plots of height fields converted to nodes, stored after all others, and to patches for CUDA."""

import numpy as np
import numpy.typing as npt

from rigcast.kernels.geometry import PATCHES, Patch
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, NO_CHILD, OUTWARDS, empty_nodes, struct_zeros


def lead_to_nodes(nodes: npt.NDArray[np.void], first: int) -> npt.NDArray[np.void]:
    """The nodes with child plot k replaced by node first + k."""
    led = nodes.copy()
    child = led["child"]
    led["child"] = np.where((~child >= FIRST_PLOT) & (child != NO_CHILD), ~child - FIRST_PLOT + first, child)
    return led


def patches_of(
    plots: npt.NDArray[np.void], sides: npt.NDArray[np.float32], first_side: int = 0
) -> npt.NDArray[np.void]:
    """The patches (PATCHES n,) of Patch of n plots; absent ones have NaN in x or y.

    first_side: index that plots use for sides[0].
    """
    patches = struct_zeros(Patch, PATCHES * len(plots))
    grid = patches.reshape(-1, 2, 4)
    grid["x"] = _threes(sides[plots["x"][:, None] - first_side + np.arange(9)], 1)[:, None]
    grid["y"] = _threes(sides[plots["y"][:, None] - first_side + np.arange(5)], 1)[:, :, None]
    grid["z"] = _threes(_threes(plots["z"], 1), 2)
    grid["face"] = plots["face"][:, None, None]
    return patches


def nodes_of(patches: npt.NDArray[np.void], first_patch: int = 0) -> npt.NDArray[np.void]:
    """Nodes (n,) of Node over the patches of n plots. first_patch: number of the first patch."""
    nodes = empty_nodes(len(patches) // PATCHES)
    is_there = np.isfinite(patches["x"][:, 1]) & np.isfinite(patches["y"][:, 1])
    for axis in "xyz":
        # transposed, because NumPy is slow to reduce short rows
        values = np.ascontiguousarray(patches[axis].reshape(len(patches), 9 if axis == "z" else 3).T)
        low, high = np.fmin.reduce(values), np.fmax.reduce(values)
        center = np.float32(0.5) * low + np.float32(0.5) * high
        half = np.maximum(high - center, center - low) * np.float32(OUTWARDS)
        nodes[f"center_{axis}"] = np.where(is_there, center, 0).reshape(-1, PATCHES)
        nodes[f"half_{axis}"] = np.where(is_there, half, -np.inf).reshape(-1, PATCHES)
    number = ~(FIRST_PATCH + first_patch + np.arange(len(patches), dtype=np.int32))
    nodes["child"] = np.where(is_there, number, NO_CHILD).reshape(-1, PATCHES)
    return nodes


def _threes(values: npt.NDArray[np.float32], axis: int) -> npt.NDArray[np.float32]:
    """A view of the windows 0..2, 2..4, 4..6, ... along an axis, as a new last axis of size 3."""
    return np.lib.stride_tricks.sliding_window_view(values, 3, axis)[(slice(None),) * axis + (slice(None, None, 2),)]
