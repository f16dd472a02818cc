"""Triangle trees kept on disk, so that a second start with the same meshes does not build them."""

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.geometry import TriangleTree
from rigcast.kernels.trees.triangle_tree import build_triangle_tree

from .disk_cache import Arrays, kept_arrays

FEWEST_FACES = 1000
"""Trees of fewer faces are built sooner than read."""

_NAMES = [field.name for field in fields(TriangleTree)]


def cached_triangle_tree(vertices: ArrayLike, faces: ArrayLike) -> TriangleTree:
    """What build_triangle_tree makes of them, read from disk where it was built before; raises what that raises."""
    v, f = np.asarray(vertices), np.asarray(faces)
    if len(f) < FEWEST_FACES:
        return build_triangle_tree(v, f)
    arrays = kept_arrays(_NAMES, (v, f), lambda: _arrays(build_triangle_tree(v, f)))
    return TriangleTree(**{name: _plain(array) for name, array in arrays.items()})


def _arrays(tree: TriangleTree) -> Arrays:
    return {name: np.asarray(getattr(tree, name)) for name in _NAMES}


def _plain(array: NDArray[Any]) -> Any:
    return array if array.ndim else array.item()
