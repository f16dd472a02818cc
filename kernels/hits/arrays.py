"""The arrays of hits, with one entry per ray."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from .out import Out

HIT_NAMES = ("distance", "shape", "face", "normal")
"""Names of the arrays of HitArrays."""
BYTES_PER_HIT = 24
"""Size of one ray's entries in HitArrays."""


@dataclass(frozen=True)
class HitArrays:
    """The output of a cast, one entry per ray.

    distance: float32 [m], +inf on a miss, NaN for a ray that is not finite or starts beyond FARTHEST.
    shape, face: int32, -1 on a miss. normal: vec3, unit, outward, in the world; 0 on a miss.
    """

    distance: wp.array
    shape: wp.array
    face: wp.array
    normal: wp.array

    def out(self) -> Out:
        """The same arrays as a struct for kernels."""
        out = Out()
        out.distance, out.shape, out.face, out.normal = self.distance, self.shape, self.face, self.normal
        return out

    def lend(self, out: Any) -> None:
        """Point `out`, an Out as ctypes struct, at these arrays. It holds no reference: the caller keeps them alive."""
        for name in HIT_NAMES:
            setattr(out, name, getattr(self, name).__ctype__())

    def of_worlds(self, part: slice, worlds: int) -> "HitArrays":
        """Views of the hits of worlds `part`, of `worlds` in all."""
        count = self.distance.size // worlds
        rays = slice(part.start * count, part.stop * count)
        return HitArrays(self.distance[rays], self.shape[rays], self.face[rays], self.normal[rays])

    @staticmethod
    def empty(count: int, device: wp.DeviceLike) -> "HitArrays":
        return HitArrays(
            wp.empty(count, dtype=float, device=device),
            wp.empty(count, dtype=int, device=device),
            wp.empty(count, dtype=int, device=device),
            wp.empty(count, dtype=wp.vec3, device=device),
        )
