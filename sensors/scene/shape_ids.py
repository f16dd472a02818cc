"""The kind of object that each shape of a scene belongs to, and its id."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.hits.reading import look_up

from .parts.part import OWNERS, Owner


@dataclass(frozen=True, eq=False)
class ShapeIds:
    """of_shape: for geoms, and other kinds in the scene, ids (n,) int32 of all shapes; -1 for those of other kinds."""

    of_shape: Mapping[Owner, wp.array]

    @staticmethod
    def of(owners: NDArray[np.str_], ids: NDArray[np.int32], device: wp.Device) -> "ShapeIds":
        """From the kind (n,) and id (n,) of each shape."""
        return ShapeIds(
            {
                owner: wp.array(np.where(owners == owner, ids, -1), dtype=int, device=device)
                for owner in OWNERS
                if owner == "geom" or owner in owners
            }
        )

    def are_shapes(self, owner: Owner) -> bool:
        """Whether all shapes are of this kind and shape k has id k, as for geoms of a scene that has nothing else."""
        return [owner] == list(self.of_shape)

    def look_up(self, owner: Owner, shape: wp.array, out: wp.array | None = None) -> wp.array:
        """Ids (n,) int32 of the objects hit, -1 for another kind or a miss. The scene must have this kind."""
        return look_up(self.of_shape[owner], shape, out)
