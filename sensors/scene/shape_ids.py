"""What kind of thing each shape of a scene is, and its id among those."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.hits.reading import look_up

from .parts.part import OWNERS, Owner


@dataclass(frozen=True, eq=False)
class ShapeIds:
    """of_shape: (n,) int32, the ids of all shapes, -1 of other kinds; of each kind that the scene has, and of geoms."""

    of_shape: Mapping[Owner, wp.array]

    @staticmethod
    def of(owners: NDArray[np.str_], ids: NDArray[np.int32], device: wp.Device) -> "ShapeIds":
        """Of shapes of these kinds (n,), with these ids (n,)."""
        return ShapeIds(
            {
                owner: wp.array(np.where(owners == owner, ids, -1), dtype=int, device=device)
                for owner in OWNERS
                if owner == "geom" or owner in owners
            }
        )

    def are_shapes(self, owner: Owner) -> bool:
        """Whether shape k has the id k, and all are of this kind: geoms of a scene that has nothing else."""
        return [owner] == list(self.of_shape)

    def look_up(self, owner: Owner, shape: wp.array, out: wp.array | None = None) -> wp.array:
        """(n,) int32: ids of what was hit, -1 where that is of another kind, or -1 itself; the scene has some of it."""
        return look_up(self.of_shape[owner], shape, out)
