"""The cast of rays in packets, on the CPU."""

from typing import Any

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.hits.arrays import BYTES_PER_HIT
from rigcast.kernels.launching.slices import OverTiles
from rigcast.kernels.launching.stack import align_stack
from rigcast.kernels.launching.turns import end_of_run, take_run
from rigcast.kernels.packets.hits.places import Places, place_packet, stage_packet
from rigcast.kernels.packets.hits.staging import PacketOut, end_stream, stage_misses, write_part
from rigcast.kernels.packets.traverse.tile import cast_tile
from rigcast.kernels.poses.scope import scope_of
from rigcast.kernels.rays.arrays import RayArrays, firing_of, origin_of, span_of
from rigcast.kernels.rays.coherent import Packets
from rigcast.kernels.single.cast import Job, is_castable
from rigcast.kernels.trees.nodes import Node

from .packet import PACKETS, Directions, Facets, Packet, PacketHits, Tile, TileRays, Vectors, axis_ray
from .prefetch import prefetch_out, prefetch_packet, prefetch_tile

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


STREAMED_FROM = 2**20
"""Size of all hits [bytes] from which they are streamed past the cache; smaller results stay cached until read."""


@wp.struct
class InPackets:
    """The tiles to cast, the same in every world, and the scratch of each thread."""

    worlds: int
    is_streamed: bool
    tiles: wp.array[Tile]
    packets: wp.array[Packet]
    # scratch:
    copies: wp.array2d[Geometry]  # (threads, 1)
    rays: wp.array2d[TileRays]  # (threads, 1)
    best: wp.array[PacketHits]
    world_directions: wp.array[Directions]
    local_directions: wp.array2d[Vectors]  # (threads, 1)
    places: wp.array2d[Places]  # (threads, PACKETS)
    hits: wp.array2d[PacketOut]  # (threads, PACKETS)
    opened: wp.array2d[Node]  # (threads, 1)
    composed: wp.array2d[TriangleBlock]  # (threads, 1)
    facets: wp.array2d[Facets]  # (threads, 1)


@wp.func
def equip(rays: wp.array[TileRays], thread: int, held: wp.array[Geometry], job: Job, these: InPackets) -> None:
    """Set those fields of a thread's TileRays that are the same for all of its tiles."""
    rays[0].limit = job.limit
    rays[0].cull = job.cull
    rays[0].fields = job.fields
    rays[0].packets = these.packets
    rays[0].geometry = held
    rays[0].first_slot = thread * PACKETS
    rays[0].best = these.best
    rays[0].directions = these.world_directions
    rays[0].local = these.local_directions[thread]
    rays[0].opened = these.opened[thread]
    rays[0].composed = these.composed[thread]
    rays[0].plot = -1
    rays[0].patch = -1
    rays[0].facets = these.facets[thread]


@wp.func
def aim(rays: wp.array[TileRays], held: wp.array[Geometry], own: RayArrays, tiles: wp.array[Tile], at: int) -> None:
    """Load tile `at`, counted over all worlds, and place its rays in the world."""
    world = at / tiles.shape[0]
    index = at % tiles.shape[0]
    rays[0].tile = tiles[index]
    ray = world * own.count + rays[0].tile.ray
    firing = firing_of(own, ray)
    rotation = own.rotation[firing]
    rays[0].start = origin_of(own, ray)
    rays[0].origin = own.position[firing] + rotation * rays[0].start
    rays[0].rotation = rotation
    rays[0].axis = rotation * rays[0].tile.axis
    rays[0].u = rotation * rays[0].tile.u
    rays[0].v = rotation * rays[0].tile.v
    rays[0].scope = scope_of(held, span_of(own, firing), firing)
    rays[0].first_ray = world * own.count
    rays[0].first_packet = index * PACKETS


@wp.kernel
def cast_packets(thread: int, taken: wp.array[int], g: Geometry, job: Job, these: InPackets) -> None:
    """Cast the tiles of all worlds, in runs that each thread claims. taken: number of tiles claimed so far."""
    align_stack()
    g.visible = job.visible
    these.copies[thread, 0] = g
    held = these.copies[thread]
    tiles = these.tiles
    packets = these.packets
    own = job.rays
    out = job.out
    rays = these.rays[thread]
    places = these.places[thread]
    staged = these.hits[thread]
    equip(rays, thread, held, job, these)
    count = these.worlds * tiles.shape[0]
    threads = these.copies.shape[0]
    at = take_run(taken, count, threads)
    end = end_of_run(at, count, threads)
    while at < count:
        aim(rays, held, own, tiles, at)
        following = (at + 1) % tiles.shape[0]
        prefetch_tile(tiles, following)
        if is_castable(axis_ray(rays)):
            stage_misses(staged, wp.inf)
            cast_tile(g, rays)
            for k in range(PACKETS):
                if rays[0].met != 0:  # after a tile that met no shape, the next one seldom meets any
                    prefetch_packet(packets, following * PACKETS + k)
                if rays[0].met & (1 << k) != 0:
                    place_packet(g, rays, places, k)
            for k in range(PACKETS):
                if rays[0].met & (1 << k) != 0:
                    stage_packet(staged, rays, places, k, out)
        else:
            stage_misses(staged, wp.nan)
        for k in range(PACKETS):
            if tiles[following].across == 0:
                prefetch_out(out, packets, following * PACKETS + k, rays[0].first_ray)
            write_part(out, rays, staged, k, these.is_streamed)
        at += 1
        if at == end:
            at = take_run(taken, count, threads)
            end = end_of_run(at, count, threads)
    end_stream()


def prepare_packets(geometry: Geometry, job: Job, packets: Packets, worlds: int) -> OverTiles:
    """A launch that casts all packets in each of the worlds."""

    def inputs(threads: int) -> list[Any]:
        these = InPackets()
        these.worlds, these.tiles, these.packets = worlds, packets.tiles, packets.packets
        these.is_streamed = BYTES_PER_HIT * worlds * job.rays.count >= STREAMED_FROM
        these.copies = wp.empty((threads, 1), dtype=Geometry, device="cpu")
        these.rays = wp.empty((threads, 1), dtype=TileRays, device="cpu")
        these.best = wp.empty(threads * PACKETS, dtype=PacketHits, device="cpu")
        these.world_directions = wp.empty(threads * PACKETS, dtype=Directions, device="cpu")
        these.local_directions = wp.empty((threads, 1), dtype=Vectors, device="cpu")
        these.places = wp.empty((threads, PACKETS), dtype=Places, device="cpu")
        these.hits = wp.empty((threads, PACKETS), dtype=PacketOut, device="cpu")
        these.opened = wp.empty((threads, 1), dtype=Node, device="cpu")
        these.composed = wp.empty((threads, 1), dtype=TriangleBlock, device="cpu")
        these.facets = wp.empty((threads, 1), dtype=Facets, device="cpu")
        return [geometry, job, these]

    return OverTiles(cast_packets, worlds * packets.tiles.size, inputs)
