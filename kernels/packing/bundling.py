"""Sorting parallel rays into bundles of neighbours, as rigcast.kernels.bundles casts them."""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.rays.coherent import Bundles

from .sorting import Doubles, Indices, halved_to, in_parts

BUNDLE = wp.constant(16)
"""Number of rays of a bundle."""
_CHUNK = 32 * BUNDLE


def sort_into_bundles(origins: Doubles, group: npt.NDArray[np.int32]) -> Bundles:
    """Sort rays with origins (n, 3) [m] into bundles of neighbours within each group.

    group: (n,), equal for rays of the same direction and firing.
    """
    order = np.argsort(group, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    return Bundles(wp.array(np.concatenate([_bundles_of(rays, origins) for rays in groups]), dtype=int, device="cpu"))


def _bundles_of(rays: Indices, origins: Doubles) -> Indices:
    """Bundles (m, BUNDLE) of neighbouring rays (n,), padded with -1."""
    chunks = in_parts(rays, origins, _CHUNK)
    whole = np.array([chunk for chunk in chunks if len(chunk) == _CHUNK], np.int64).reshape(-1, _CHUNK)
    rest = [part for chunk in chunks if len(chunk) != _CHUNK for part in in_parts(chunk, origins, BUNDLE)]
    filled = [np.concatenate([part, np.full(BUNDLE - len(part), -1)]) for part in rest]
    return np.concatenate([halved_to(whole, origins, BUNDLE), *(part[None] for part in filled)])
