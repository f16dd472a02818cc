"""Sorting parallel rays into bundles of neighbours, as rigcast.kernels.bundles casts them."""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.rays.coherent import Bundles

from .sorting import Doubles, Indices, halved_to, in_chunks, in_parts, members_of_groups

BUNDLE = wp.constant(16)
"""Number of rays of a bundle."""
_CHUNK = 32 * BUNDLE


def sort_into_bundles(origins: Doubles, group: npt.NDArray[np.int32]) -> Bundles:
    """Sort rays with origins (n, 3) [m] into bundles of neighbours within each group.

    group: (n,), equal for rays of the same direction and firing.
    """
    bundles = [_bundles_of(rays, origins) for rays in members_of_groups(group)]
    return Bundles(wp.array(np.concatenate(bundles), dtype=int, device="cpu"))


def _bundles_of(rays: Indices, origins: Doubles) -> Indices:
    """Bundles (m, BUNDLE) of neighbouring rays (n,), padded with -1."""
    chunks, others = in_chunks(rays, origins, _CHUNK)
    rest = [part for chunk in others for part in in_parts(chunk, origins, BUNDLE)]
    filled = [np.concatenate([part, np.full(BUNDLE - len(part), -1)]) for part in rest]
    return np.concatenate([halved_to(chunks, origins, BUNDLE), *(part[None] for part in filled)])
