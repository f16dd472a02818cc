"""What the physics of every sensor does."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import warp as wp

from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.rays.arrays import Rays

Brightness = Callable[[wp.array | None], wp.array]
"""How bright rays come back, float32 of each, worked out when it is asked for; into this array, or a new one."""


class Reading(NamedTuple):
    """hits: (n k) the returns, k for each of n rays, normals in the rays' frame. brightness: of these returns."""

    hits: HitArrays
    brightness: Brightness


class Physics(Protocol):
    """The effects that the specification of one sensor asks for, ready on the device of a stage."""

    @property
    def bytes_per_ray(self) -> int:
        """The most memory that a reading takes for each of its rays."""
        ...

    @property
    def kept_bytes_per_ray(self) -> int:
        """What stays of that for as long as the frame, beside its hits."""
        ...

    def read(self, rays: Rays, visible: wp.array, source: RandomSource) -> Reading:
        """One reading of the stage, with the sensor's rays in its pose now."""
        ...
