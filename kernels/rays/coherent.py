"""Rays that are cast together as they go much the same way: on the CPU in packets or bundles, on CUDA in warps."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import warp as wp


@dataclass(frozen=True)
class Packets:
    """Rays sorted into tiles of packets, on the CPU.

    singles: the rays that go alone.
    """

    tiles: wp.array
    packets: wp.array
    singles: wp.array

    @cached_property
    def order(self) -> npt.NDArray[np.int32]:
        """(n,) all rays, as they follow each other in the packets; those that go alone are the last."""
        rays = self.packets.numpy()["ray"].reshape(-1)
        return np.concatenate([rays[rays >= 0], self.singles.numpy()])


@dataclass(frozen=True)
class Bundles:
    """Rays that are cast in bundles, on the CPU.

    rays: (m, k) int32, up to k of each bundle by their number; where it has fewer, -1 follows.
    """

    rays: wp.array


@dataclass(frozen=True)
class Warps:
    """Rays on CUDA.

    order: (n,) int32, all of them, 32 neighbours after 32 neighbours.
    """

    order: wp.array
