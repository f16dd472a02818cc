"""The rays of one sensor, in its own frame."""

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .lens import Lens

if TYPE_CHECKING:  # cards of devices are drawn without Warp
    from rigcast.kernels.rays.coherent import Packets

MOST_RAYS = 2**26  # of one reading, with 1.6 GB of directions; more is a mistake


def refuse_too_many(rays: int) -> None:
    """Raise ValueError for more rays of one reading than MOST_RAYS."""
    if rays > MOST_RAYS:
        raise ValueError(f"makes {Decimal(rays):.2e} rays, expected at most {MOST_RAYS}")


@dataclass(frozen=True, eq=False)
class Pattern:
    """The rays of one reading, built once when a sensor is bound to a model.

    directions: (*shape, 3) float64, unit, in the sensor's frame.
    origins: (*shape, 3) float64 [m] in the sensor's frame; None when every ray leaves the frame's origin.
    firing_times: (*shape) float64 [s], time of each ray after the first one; None if all are fired at once.
    ring, column: (*shape) int32, row and column of each ray of a lidar; None for other sensors.
    intrinsics: (3, 3) float64 [pixels], `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]` with (0, 0) at the top left
        *corner* of the image, pixel centres at +0.5; None for other sensors than cameras.
    lens: of a camera; None for a pinhole.
    subrays: (*shape, k, 3) unit, the rays that are cast in place of each of `directions`; None: these themselves.
    later: for a pattern that changes with each reading, computes that of the reading at a time [s], given also
        whether packets are useful. This one is then that of the reading at time 0; shape and origins are always
        the same.
    packets: the same rays in packets on the CPU, if they were packed when they were computed.
    """

    directions: NDArray[np.float64]
    origins: NDArray[np.float64] | None = None
    firing_times: NDArray[np.float64] | None = None
    ring: NDArray[np.int32] | None = None
    column: NDArray[np.int32] | None = None
    intrinsics: NDArray[np.float64] | None = None
    lens: Lens | None = None
    subrays: NDArray[np.float64] | None = None
    later: "Callable[[float, bool], Pattern] | None" = None
    packets: "Packets | None" = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the rays: (beams, columns) for a table of beams, (height, width) for a camera, else (rays,)."""
        return self.directions.shape[:-1]

    @property
    def duration(self) -> float:
        """Time from the first ray to the last [s]."""
        return 0.0 if self.firing_times is None else float(self.firing_times.max())

    def at(self, time: float, in_packets: bool = False) -> "Pattern":
        """The pattern of the reading that begins at `time` [s]. in_packets: whether `packets` are useful."""
        return self if self.later is None else self.later(time, in_packets)


def directions_at(azimuth: NDArray[np.float64], elevation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (..., 3), x forward, y left, z up, of azimuth from +x about +z and elevation above x-y [rad]."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)


def azimuth_elevation(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The angles [rad] of unit vectors (..., 3): azimuth in (-pi, pi], elevation in [-pi / 2, pi / 2]."""
    flat = np.hypot(directions[..., 0], directions[..., 1])
    return np.arctan2(directions[..., 1], directions[..., 0]), np.arctan2(directions[..., 2], flat)
