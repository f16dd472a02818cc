"""Code shared by flexes and skins: surfaces whose vertices move, carried by one or several bodies."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.world.deform import DeformingTree


def flat_surfaces(counts: Iterable[int], faces: Iterable[NDArray[np.int32]]) -> list[DeformingTree]:
    """A tree for each surface, over its faces (m, 3); its vertices, counts[k] of them, are at 0 until moved."""
    return [DeformingTree(np.zeros((count, 3)), own) for count, own in zip(counts, faces, strict=True)]


def lost_owners(
    vertices: NDArray[np.float64], owner: NDArray[np.integer], count: int, farthest: float
) -> NDArray[np.bool_]:
    """Which owners (count,) have a vertex that is not finite or beyond `farthest` [m]. owner: (n,) of each vertex."""
    is_lost = ~(np.abs(vertices) <= farthest).all(axis=1)
    return np.bincount(owner[is_lost], minlength=count) > 0


def only_bodies(carriers: Sequence[NDArray[np.int32]]) -> NDArray[np.int32]:
    """The body (n,) that carries each object, -1 if there are several."""
    return np.array([bodies[0] if len(bodies) == 1 else -1 for bodies in carriers], np.int32)


def all_hidden(carriers: Sequence[NDArray[np.int32]], hidden: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which objects (n,) have all of their bodies among the hidden ones (nbody,)."""
    return np.array([hidden[bodies].all() for bodies in carriers], bool)
