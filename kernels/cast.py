"""The cast: the rays of a sensor, through the geometry, to hits."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import warp as wp

from .geometry import Geometry, TriangleBlock
from .hits.arrays import BYTES_PER_HIT, HitArrays
from .hits.out import FIELD_NAMES, Out
from .launching.slices import OverTiles
from .launching.stack import align_stack
from .launching.turns import end_of_run, take_run
from .packets.packet import PACKETS, Directions, Facets, Packet, PacketHits, Tile, TileRays, Vectors, axis_ray
from .packets.places import Places, place_packet, stage_packet
from .packets.prefetch import prefetch_out, prefetch_packet, prefetch_tile
from .packets.staging import PacketOut, end_stream, stage_misses, write_part
from .packets.tile import cast_tile
from .poses.moving import at_firings
from .poses.scope import scope_of
from .rays.arrays import RayArrays, Rays, firing_of, origin_of, span_of
from .rays.coherent import Bundles, Packets, Warps
from .shapes.triangle import CULL_NONE
from .single.cast import RAYS_PER_RUN, Alone, Job, cast_turns, is_castable

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


STREAMED_FROM = 2**20
"""Bytes of hits that are written past the cache: fewer stay in it until they are read."""


@wp.struct
class InPackets:
    """Tiles of packets, those of every world, and scratch of each thread."""

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
    composed: wp.array2d[TriangleBlock]  # (threads, 1)
    facets: wp.array2d[Facets]  # (threads, 1)


@wp.func
def equip(rays: wp.array[TileRays], thread: int, held: wp.array[Geometry], job: Job, these: InPackets) -> None:
    """Write what is the same for all tiles of a thread."""
    rays[0].limit = job.limit
    rays[0].cull = job.cull
    rays[0].fields = job.fields
    rays[0].packets = these.packets
    rays[0].geometry = held
    rays[0].first_slot = thread * PACKETS
    rays[0].best = these.best
    rays[0].directions = these.world_directions
    rays[0].local = these.local_directions[thread]
    rays[0].composed = these.composed[thread]
    rays[0].facets = these.facets[thread]


@wp.func
def aim(rays: wp.array[TileRays], held: wp.array[Geometry], own: RayArrays, tiles: wp.array[Tile], at: int) -> None:
    """Write tile `at` of all worlds, where its rays are."""
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
    """Tiles that no other thread takes, one after the other, of all worlds. taken: how many were."""
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
                if rays[0].met != 0:  # where no shape is met, the next tile is not likely to meet any
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


def cast(
    geometry: Geometry, visible: wp.array, rays: Rays, limit: float, cull: int, out: HitArrays | None = None
) -> HitArrays:
    """Each ray's first hit among the visible shapes, up to and including limit [m].

    Args:
        visible: bool per shape, for all worlds, or for each shape of each world.
        cull: CULL_NONE, CULL_BACK or CULL_FRONT of rigcast.kernels.shapes.triangle.
        out: where to write; None makes new arrays.

    Returns:
        One entry per ray, world after world.
    """
    hits = HitArrays.empty(rays.total, rays.directions.device) if out is None else out
    _launch(_prepare(geometry, rays, _job(visible, rays, limit, cull, hits.out())))
    return hits


class Launch(Protocol):
    """A launch for as often as it is wanted."""

    def launch_with(self, others: Sequence[Any]) -> object:
        """Launch it, and others of its type, all at once. Gives what a graph that repeats that is to hold."""
        ...


class Readings(NamedTuple):
    """A cast whose hits are readings: launches for as often as it is wanted, that hold no arrays which they write."""

    launches: Sequence[Launch]
    job: Job

    def turn_to(self, hits: HitArrays, rays: Rays, fields: Mapping[str, wp.array]) -> None:
        """From now on write these hits and, of rigcast.kernels.hits.out.FIELD_NAMES, these fields.

        rays: those that it was prepared for, wherever they are now. Whoever launches keeps the arrays.
        """
        job = self.job.__ctype__()
        hits.lend(job.out)
        for name in FIELD_NAMES:
            setattr(job.fields, name, fields[name].__ctype__() if name in fields else type(getattr(job.fields, name))())
        job.rays.position, job.rays.rotation = rays.position.__ctype__(), rays.rotation.__ctype__()


def prepare_readings(
    geometry: Geometry, visible: wp.array, rays: Rays, limits: tuple[float, float], body_of_shape: wp.array
) -> Readings:
    """A cast whose hits are readings between these limits [m], once it is turned to where they go.

    What is nearer is -inf, normals are in the rays' frame. It casts at shapes that stand still as they do by then, and
    at shapes that move as they do now.
    """
    out = Out()
    out.is_read, out.min_range = True, limits[0]
    job = _job(visible, rays, limits[1], CULL_NONE, out)
    job.fields.body_of_shape = body_of_shape
    return Readings(_prepare(geometry, rays, job), job)


def launch(readings: Iterable[Readings]) -> object:
    """Cast and read what several sensors see on one device, all at once: on CUDA in one launch of all their rays.

    They cast at one geometry, as it stands. Gives what a graph that repeats that is to hold.
    """
    return _launch([each for reading in readings for each in reading.launches])


def _launch(launches: Sequence[Launch]) -> object:
    return launches[0].launch_with(launches[1:]) if launches else None


def _job(visible: wp.array, rays: Rays, limit: float, cull: int, out: Out) -> Job:
    job = Job()
    job.rays, job.visible, job.limit, job.cull, job.out = rays.arrays, visible, limit, cull, out
    return job


def _prepare(geometry: Geometry, rays: Rays, job: Job) -> list[Launch]:
    device = rays.directions.device
    placed = geometry if geometry.instants == 1 else at_firings(geometry, rays)
    if rays.packets is None:
        return _prepare_alone(placed, job, wp.empty(0, dtype=int, device=device), rays.total)
    packets, worlds = rays.packets, rays.worlds
    if isinstance(packets, Warps):
        return _prepare_alone(placed, job, packets.order, rays.total)
    if isinstance(packets, Bundles):
        from .bundles.cast import prepare_bundles  # here, as a rig without parallel rays needs none of it

        return [prepare_bundles(placed, job, packets, worlds)]
    launches: list[Launch] = []
    if packets.tiles.size:
        inputs = partial(_in_packets, placed, job, packets, worlds)
        launches.append(OverTiles(cast_packets, worlds * packets.tiles.size, inputs))
    if packets.singles.size:
        launches += _prepare_alone(placed, job, packets.singles, worlds * packets.singles.size)
    return launches


def _in_packets(geometry: Geometry, job: Job, packets: Packets, worlds: int, threads: int) -> list[Any]:
    """What `cast_packets` takes in so many threads."""
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
    these.composed = wp.empty((threads, 1), dtype=TriangleBlock, device="cpu")
    these.facets = wp.empty((threads, 1), dtype=Facets, device="cpu")
    return [geometry, job, these]


def _prepare_alone(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Launch]:
    """Cast so many rays one by one: all of them, or those that `which` names, in every world."""
    prepare = _in_turns if which.device.is_cpu else _in_threads
    return prepare(geometry, job, which, count)


def _in_turns(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Launch]:
    def inputs(threads: int) -> list[Any]:
        return [geometry, job, _alone(which, count, threads)]

    return [OverTiles(cast_turns, -(-count // RAYS_PER_RUN), inputs)]


def _in_threads(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Launch]:
    from .single.threads.cast import InThreads  # here, as nothing but CUDA needs it

    return [InThreads(geometry, job, which, count)] if count else []


def _alone(which: wp.array, count: int, threads: int) -> Alone:
    alone = Alone()
    alone.count, alone.which = count, which
    alone.copies = wp.empty((threads, 1), dtype=Geometry, device=which.device)
    return alone
