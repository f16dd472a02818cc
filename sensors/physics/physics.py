"""The interface of sensor physics."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import warp as wp

from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.rays.arrays import Rays

Brightness = Callable[[wp.array | None], wp.array]
"""Computes the intensity of each return, float32, on demand, in a given array or a new one."""


class Reading(NamedTuple):
    """brightness: computes the intensity of the returns. used: what a CUDA graph that repeats the reading must hold."""

    brightness: Brightness
    used: object


class Physics(Protocol):
    """The effects in one sensor's specification, prepared on a stage's device."""

    @property
    def bytes_per_ray(self) -> int:
        """Upper bound on the memory [bytes] of a reading per ray."""
        ...

    @property
    def kept_bytes_per_ray(self) -> int:
        """Memory [bytes] per ray that is kept with the frame, besides its hits."""
        ...

    def read(self, rays: Rays, visible: wp.array, source: RandomSource, out: HitArrays) -> Reading:
        """One reading of the stage with the sensor's rays at its current pose.

        out: (n k,) returns, k for each of n rays, normals in the rays' frame.
        """
        ...
