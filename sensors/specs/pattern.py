"""The rays of one sensor, in its own frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .lens import Lens

MOST_RAYS = 2**26  # of one reading; more is a slip, and their directions alone fill 1.6 GB


@dataclass(frozen=True, eq=False)
class Pattern:
    """The rays of one reading, built once when a sensor is bound to a model.

    directions: (*shape, 3) float64, unit, in the sensor's frame.
    origins: (*shape, 3) float64 [m] in the sensor's frame; None when every ray leaves the frame's origin.
    ring, column: (*shape) int32, row and column of each ray of a lidar; None for other sensors.
    intrinsics: (3, 3) float64 [pixels], `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]` with (0, 0) at the top left
        *corner* of the image, pixel centres at +0.5; None for other sensors than cameras.
    lens: of a camera, None where it is a pinhole.
    subrays: (*shape, k, 3) unit, the rays that are cast in place of each of `directions`; None: these themselves.
    """

    directions: NDArray[np.float64]
    origins: NDArray[np.float64] | None = None
    ring: NDArray[np.int32] | None = None
    column: NDArray[np.int32] | None = None
    intrinsics: NDArray[np.float64] | None = None
    lens: Lens | None = None
    subrays: NDArray[np.float64] | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """(beams, columns) for a lidar, (height, width) for a camera, (rays,) for a height scan."""
        return self.directions.shape[:-1]
