"""Groups of coherent rays that are cast together: on the CPU packets or bundles, on CUDA warps."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import warp as wp


@dataclass(frozen=True)
class Packets:
    """Rays sorted into tiles of packets, on the CPU.

    tiles: (n,) of Tile. packets: (n PACKETS,) of Packet. singles: int32, the rays that are cast singly.
    """

    tiles: wp.array
    packets: wp.array
    singles: wp.array

    @cached_property
    def order(self) -> npt.NDArray[np.int32]:
        """Numbers of all rays (n,) in the order of the packets; the single rays come last."""
        rays = self.packets.numpy()["ray"].reshape(-1)
        return np.concatenate([rays[rays >= 0], self.singles.numpy()])


@dataclass(frozen=True)
class Bundles:
    """Rays sorted into bundles, on the CPU.

    rays: (m, k) int32, the numbers of up to k rays of each bundle, padded with -1.
    """

    rays: wp.array


@dataclass(frozen=True)
class Warps:
    """Rays sorted into warps, on CUDA.

    order: (n,) int32, the numbers of all rays; every 32 in a row are neighbours.
    """

    order: wp.array
