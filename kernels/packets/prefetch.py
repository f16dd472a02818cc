"""Nodes, blocks, packets and hits on their way into the cache of a CPU, before they are needed."""

import warp as wp

from rigcast.kernels.geometry import Plot, TriangleBlock
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.stack import CACHE_LINE
from rigcast.kernels.trees.nodes import Node

from .packet import LANES, Packet, Tile


def _prefetch(array: str) -> str:
    """Of C++, that asks for all cache lines of element i; a GPU hides latencies by its many threads."""
    return f"""
#if !defined(__CUDA_ARCH__)
    const char* element = (const char*)&{array}.data[i];
    for (size_t at = 0; at < sizeof({array}.data[0]); at += {CACHE_LINE}) __builtin_prefetch(element + at);
#endif
"""


# without a return type, which Warp 1.12 would take for that of a value
@wp.func_native(_prefetch("nodes"))
def prefetch_node(nodes: wp.array[Node], i: int):  # type: ignore[no-untyped-def]
    """Ask for node i."""


@wp.func_native(_prefetch("blocks"))
def prefetch_block(blocks: wp.array[TriangleBlock], i: int):  # type: ignore[no-untyped-def]
    """Ask for block i."""


@wp.func_native(_prefetch("plots"))
def prefetch_plot(plots: wp.array[Plot], i: int):  # type: ignore[no-untyped-def]
    """Ask for plot i."""


@wp.func_native(_prefetch("packets"))
def prefetch_packet(packets: wp.array[Packet], i: int):  # type: ignore[no-untyped-def]
    """Ask for packet i."""


@wp.func_native(_prefetch("tiles"))
def prefetch_tile(tiles: wp.array[Tile], i: int):  # type: ignore[no-untyped-def]
    """Ask for tile i."""


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __builtin_prefetch(&out.distance.data[i], 1);
    __builtin_prefetch(&out.shape.data[i], 1);
    __builtin_prefetch(&out.face.data[i], 1);
    __builtin_prefetch(&out.normal.data[i], 1);
#endif
""")
def prefetch_hit(out: Out, i: int):  # type: ignore[no-untyped-def]
    """Ask for where hit i will be written."""


@wp.func
def prefetch_out(out: Out, packets: wp.array[Packet], at: int, first_ray: int) -> None:
    """Ask for where the hits of a packet will be written, which are all over the rows of an image.

    first_ray: of its world. Without a ray it asks for what is not there, which harms nothing.
    """
    numbers = packets[at].ray
    for lane in range(LANES):
        prefetch_hit(out, first_ray + numbers[lane])
