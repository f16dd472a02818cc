"""What rays hit, as arrays of one entry for each."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from .out import Out

HIT_NAMES = ("distance", "shape", "face", "normal")
"""Of the arrays of HitArrays."""
BYTES_PER_HIT = 24
"""Of a ray in them."""


@dataclass(frozen=True)
class HitArrays:
    """What a cast writes, one entry per ray.

    distance: float32 [m], +inf on a miss, NaN for a ray that is not finite or starts beyond FARTHEST.
    shape, face: int32, -1 on a miss. normal: vec3, unit, outward, in the world; 0 on a miss.
    """

    distance: wp.array
    shape: wp.array
    face: wp.array
    normal: wp.array

    def out(self) -> Out:
        """The same arrays for a kernel."""
        out = Out()
        out.distance, out.shape, out.face, out.normal = self.distance, self.shape, self.face, self.normal
        return out

    def lend(self, out: Any) -> None:
        """Let `out`, as ctypes has it, be written here from now on. Whoever launches keeps the arrays."""
        for name in HIT_NAMES:
            setattr(out, name, getattr(self, name).__ctype__())

    def of_worlds(self, part: slice, worlds: int) -> "HitArrays":
        """Those of some of so many worlds, without a copy."""
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
