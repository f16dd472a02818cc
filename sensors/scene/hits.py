"""What a cast gives back."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray


class NumpyHits(NamedTuple):
    """The fields of Hits as numpy arrays."""

    distance: NDArray[np.float32]
    geom_id: NDArray[np.int32]
    flex_id: NDArray[np.int32]
    skin_id: NDArray[np.int32]
    prop_id: NDArray[np.int32]
    face: NDArray[np.int32]
    normal: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Hits:
    """The first hit of each ray, as Warp arrays on the scene's device, of the shape (...) of the rays.

    distance: (...) float32 [m], +inf on a miss, NaN for a ray on the device that is not finite.
    geom_id, flex_id, skin_id, prop_id: (...) int32, -1 unless that kind was hit.
    face: (...) int32, triangle within the mesh or height field, -1 otherwise.
    normal: (..., 3) float32, unit, outward whatever the ray's direction, in the world; 0 on a miss.

    Of a single ray, (3,), the Warp arrays have shape (1,) and those of `numpy()` have none.
    """

    distance: wp.array
    geom_id: wp.array
    flex_id: wp.array
    skin_id: wp.array
    prop_id: wp.array
    face: wp.array
    normal: wp.array
    shape: tuple[int, ...]

    def numpy(self) -> NumpyHits:
        """The same fields as numpy arrays; on the CPU they are views of the Warp arrays."""
        return NumpyHits(
            self.distance.numpy().reshape(self.shape),
            self.geom_id.numpy().reshape(self.shape),
            self.flex_id.numpy().reshape(self.shape),
            self.skin_id.numpy().reshape(self.shape),
            self.prop_id.numpy().reshape(self.shape),
            self.face.numpy().reshape(self.shape),
            self.normal.numpy().reshape((*self.shape, 3)),
        )
