"""Triangle trees kept on disk, so that a second start with the same meshes does not build them."""

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.geometry import TriangleTree
from rigcast.kernels.trees.triangle_tree import build_triangle_tree

from .disk_cache import Arrays, cache_folder, keep_arrays, place_of, read_arrays

FEWEST_FACES = 1000
"""Trees of fewer faces are built sooner than read."""


def cached_triangle_tree(vertices: ArrayLike, faces: ArrayLike) -> TriangleTree:
    """What build_triangle_tree makes of them, read from disk where it was built before; raises what that raises."""
    v, f = np.asarray(vertices), np.asarray(faces)
    folder = cache_folder()
    if folder is None or len(f) < FEWEST_FACES:
        return build_triangle_tree(v, f)
    path = place_of(folder, v, f)
    tree = _tree(read_arrays(path))
    if tree is None:
        tree = build_triangle_tree(v, f)
        keep_arrays({name: np.asarray(getattr(tree, name)) for name in _NAMES}, path)
    return tree


_NAMES = [field.name for field in fields(TriangleTree)]


def _tree(arrays: Arrays | None) -> TriangleTree | None:
    """The tree of these arrays, None if they are not all there."""
    if arrays is None or arrays.keys() != set(_NAMES):
        return None
    return TriangleTree(**{name: _plain(array) for name, array in arrays.items()})


def _plain(array: NDArray[Any]) -> Any:
    return array if array.ndim else array.item()
