"""Prefetches of nodes, blocks, packets and output lines into the CPU's cache."""

import warp as wp

from rigcast.kernels.geometry import Plot, TriangleBlock
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.stack import CACHE_LINE
from rigcast.kernels.trees.nodes import Node

from .packet import LANES, Packet, Tile


def _prefetch(array: str) -> str:
    """C++ that prefetches all cache lines of element i; empty on a GPU, which hides latency by its many threads."""
    return f"""
#if !defined(__CUDA_ARCH__)
    const char* element = (const char*)&{array}.data[i];
    for (size_t at = 0; at < sizeof({array}.data[0]); at += {CACHE_LINE}) __builtin_prefetch(element + at);
#endif
"""


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native(_prefetch("nodes"))
def prefetch_node(nodes: wp.array[Node], i: int):  # type: ignore[no-untyped-def]
    """Prefetch node i."""


@wp.func_native(_prefetch("blocks"))
def prefetch_block(blocks: wp.array[TriangleBlock], i: int):  # type: ignore[no-untyped-def]
    """Prefetch block i."""


@wp.func_native(_prefetch("plots"))
def prefetch_plot(plots: wp.array[Plot], i: int):  # type: ignore[no-untyped-def]
    """Prefetch plot i."""


@wp.func_native(_prefetch("packets"))
def prefetch_packet(packets: wp.array[Packet], i: int):  # type: ignore[no-untyped-def]
    """Prefetch packet i."""


@wp.func_native(_prefetch("tiles"))
def prefetch_tile(tiles: wp.array[Tile], i: int):  # type: ignore[no-untyped-def]
    """Prefetch tile i."""


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __builtin_prefetch(&out.distance.data[i], 1);
    __builtin_prefetch(&out.shape.data[i], 1);
    __builtin_prefetch(&out.face.data[i], 1);
    __builtin_prefetch(&out.normal.data[i], 1);
#endif
""")
def prefetch_hit(out: Out, i: int):  # type: ignore[no-untyped-def]
    """Prefetch the output lines of hit i for writing."""


@wp.func
def prefetch_out(out: Out, packets: wp.array[Packet], at: int, first_ray: int) -> None:
    """Prefetch the output lines of a packet's hits, which are spread over the rows of an image.

    first_ray: of the packet's world. A lane without a ray prefetches entry first_ray - 1, which may lie outside the
    arrays; a prefetch cannot fault.
    """
    numbers = packets[at].ray
    for lane in range(LANES):
        prefetch_hit(out, first_ray + numbers[lane])
