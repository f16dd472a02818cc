"""The cast: the rays of a sensor, through the geometry, to hits."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import warp as wp

from .geometry import FARTHEST, Geometry
from .hits import NO_SHAPE, Hit, WorldRay, place_of
from .launch import TURN, prepare_over_rays, prepare_over_tiles, recorded, thread_count
from .moving import at_firings
from .out import Out, write_miss, write_place
from .packets.packet import LANES, PACKETS, Directions, Packet, PacketHits, Tile, TileRays, world_ray
from .packets.places import write_closed_form, write_triangles
from .packets.prefetch import prefetch_hit, prefetch_packet
from .packets.tile import cast_tile, clear_packet
from .poses import scope_of
from .ray import cast_ray
from .rays import RayArrays, Rays, direction_of, firing_of, origin_of, span_of
from .shapes.solids import has_triangles
from .vectors import lowest_bit

RAYS_PER_RUN = wp.constant(32)
"""Of rays that a thread of the CPU casts one by one, in turns of TURN runs."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


BYTES_PER_HIT = 24
"""Of a ray in HitArrays."""


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

    def out(self) -> "Out":
        """The same arrays for a kernel."""
        out = Out()
        out.distance, out.shape, out.face, out.normal = self.distance, self.shape, self.face, self.normal
        return out

    def of_world(self, world: int, worlds: int) -> "HitArrays":
        """Those of one of so many worlds, without a copy."""
        count = self.distance.size // worlds
        rays = slice(world * count, (world + 1) * count)
        return HitArrays(self.distance[rays], self.shape[rays], self.face[rays], self.normal[rays])

    @staticmethod
    def empty(count: int, device: wp.DeviceLike) -> "HitArrays":
        return HitArrays(
            wp.empty(count, dtype=float, device=device),
            wp.empty(count, dtype=int, device=device),
            wp.empty(count, dtype=int, device=device),
            wp.empty(count, dtype=wp.vec3, device=device),
        )


@wp.func
def is_castable(ray: WorldRay) -> bool:
    """Whether a ray is finite and starts no farther than FARTHEST; comparisons with NaN are false."""
    x = wp.abs(ray.origin[0]) <= wp.float64(FARTHEST)
    y = wp.abs(ray.origin[1]) <= wp.float64(FARTHEST)
    z = wp.abs(ray.origin[2]) <= wp.float64(FARTHEST)
    return x and y and z and wp.dot(ray.direction, ray.direction) < wp.float64(wp.inf)


@wp.func
def write_hit(g: wp.array[Geometry], out: Out, i: int, hit: Hit, ray: WorldRay) -> None:
    if hit.shape == NO_SHAPE:
        write_miss(out, i, wp.inf)
        return
    place = place_of(g, hit, ray)
    write_place(out, i, hit.shape, place.distance, place.face, place.normal, ray.limit)


@wp.func
def cast_run(
    begin: int,
    end: int,
    g: wp.array[Geometry],
    which: wp.array[int],
    rays: RayArrays,
    limit: float,
    cull: int,
    out: Out,
) -> None:
    """Rays begin to end - 1, as for cast_rays."""
    for k in range(begin, end):
        i = int(k)
        if which.shape[0] > 0:
            i = k / which.shape[0] * rays.count + which[k % which.shape[0]]
        prefetch_hit(out, i)
        firing = firing_of(rays, i)
        rotation = rays.rotation[firing]
        ray = WorldRay()
        ray.origin = rays.position[firing] + rotation * origin_of(rays, i)
        ray.direction = rotation * direction_of(rays, i)
        ray.scope = scope_of(g, span_of(rays, firing), firing)
        ray.limit = limit
        ray.cull = cull
        if is_castable(ray):
            write_hit(g, out, i, cast_ray(g, ray), ray)
        else:
            write_miss(out, i, wp.nan)


@wp.kernel
def hold(g: Geometry, visible: wp.array[wp.bool], held: wp.array[Geometry]) -> None:
    """The geometry, and what a cast may hit of it, for functions that must not copy it."""
    g.visible = visible
    held[0] = g


@wp.kernel
def cast_rays(
    first: int,
    count: int,
    g: wp.array[Geometry],
    # rays:
    which: wp.array[int],  # of each world; empty for all
    rays: RayArrays,
    limit: float,
    cull: int,
    out: Out,
) -> None:
    """On CUDA, a ray per thread, of this count."""
    k = first + wp.tid()
    cast_run(k, wp.min(k + 1, count), g, which, rays, limit, cull, out)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return atomicAdd(&turns.data[0], 1);
#else
    return __atomic_fetch_add(&turns.data[0], 1, __ATOMIC_RELAXED);
#endif
""")
def turn_of(turns: wp.array[int]) -> int:  # type: ignore[empty-body]
    """The number of a turn that no other thread has: atomically, which `wp.atomic_add` is not on a CPU."""


@wp.kernel
def cast_turns(
    thread: int,  # noqa: ARG001, as prepare_over_tiles has it
    turns: wp.array[int],  # how many were taken
    count: int,
    g: wp.array[Geometry],
    # rays:
    which: wp.array[int],  # of each world; empty for all
    rays: RayArrays,
    limit: float,
    cull: int,
    out: Out,
) -> None:
    """On the CPU, turns of rays that no other thread takes, of this count."""
    begin = turn_of(turns) * TURN * RAYS_PER_RUN
    while begin < count:
        cast_run(begin, wp.min(begin + TURN * RAYS_PER_RUN, count), g, which, rays, limit, cull, out)
        begin = turn_of(turns) * TURN * RAYS_PER_RUN


@wp.func
def miss_packet(out: Out, rays: TileRays, k: int, distance: float) -> None:
    for lane in range(LANES):
        i = rays.packets[rays.first_packet + k].ray[lane]
        if i >= 0:
            write_miss(out, rays.first_ray + i, distance)


@wp.func
def write_packet(g: Geometry, out: Out, rays: TileRays, k: int) -> None:
    """Write what the rays of a packet hit, shape by shape."""
    slot = rays.first_slot + k
    numbers = rays.packets[rays.first_packet + k].ray
    shapes = rays.best[slot].shape
    todo = int(0)
    for lane in range(LANES):
        todo = todo | wp.where(numbers[lane] >= 0, 1 << lane, 0)
    while todo != 0:
        shape = shapes[lowest_bit(todo)]
        same = int(0)
        for lane in range(LANES):
            same = same | wp.where(shapes[lane] == shape, 1 << lane, 0)
        same = same & todo
        todo = todo & ~same
        if shape == NO_SHAPE:
            for lane in range(LANES):
                if same & (1 << lane) != 0:
                    write_miss(out, rays.first_ray + numbers[lane], wp.inf)
        elif has_triangles(g.kind[shape]):
            write_triangles(g, out, rays, k, same, shape)
        else:
            write_closed_form(g, out, rays, k, same, shape)


@wp.func
def prefetch_out(out: Out, rays: TileRays, k: int) -> None:
    """Ask for where the hits of a packet will be written, which are all over the rows of an image."""
    for lane in range(LANES):
        i = rays.packets[rays.first_packet + k].ray[lane]
        if i >= 0:
            prefetch_hit(out, rays.first_ray + i)


@wp.func
def tile_after(index: int, turns: wp.array[int]) -> int:
    """The next tile of a thread. A turn is a run of neighbouring tiles, whose hits share cache lines."""
    if (index + 1) % TURN == 0:
        return turn_of(turns) * TURN
    return index + 1


@wp.kernel
def cast_packets(
    thread: int,
    turns: wp.array[int],  # how many were taken
    worlds: int,
    # scene:
    g: Geometry,
    held: wp.array[Geometry],
    # rays:
    tiles: wp.array[Tile],
    packets: wp.array[Packet],
    own: RayArrays,
    limit: float,
    cull: int,
    # scratch:
    best: wp.array[PacketHits],
    world_directions: wp.array[Directions],
    out: Out,
) -> None:
    """Tiles that no other thread takes, one after the other, of all worlds."""
    at = turn_of(turns) * TURN
    while at < worlds * tiles.shape[0]:
        world = at / tiles.shape[0]
        index = at % tiles.shape[0]
        rays = TileRays()
        rays.tile = tiles[index]
        ray = world * own.count + rays.tile.ray
        firing = firing_of(own, ray)
        rotation = own.rotation[firing]
        rays.origin = own.position[firing] + rotation * origin_of(own, ray)
        rays.axis = rotation * rays.tile.axis
        rays.u = rotation * rays.tile.u
        rays.v = rotation * rays.tile.v
        rays.scope = scope_of(held, span_of(own, firing), firing)
        rays.first_ray = world * own.count
        rays.limit = limit
        rays.cull = cull
        rays.first_packet = index * PACKETS
        rays.packets = packets
        rays.geometry = held
        rays.first_slot = thread * PACKETS
        rays.best = best
        rays.directions = world_directions
        following = (at + 1) % tiles.shape[0]
        for k in range(PACKETS):
            clear_packet(rays, k, rotation)
            prefetch_out(out, rays, k)
            prefetch_packet(packets, following * PACKETS + k)
        is_sound = is_castable(world_ray(rays, rays.first_slot, 0))
        if is_sound:
            cast_tile(g, rays)
        for k in range(PACKETS):
            if is_sound:
                write_packet(g, out, rays, k)
            else:
                miss_packet(out, rays, k, wp.nan)
        at = tile_after(at, turns)


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
    for launch in prepare_cast(geometry, visible, rays, limit, cull, hits):
        launch()
    return hits


def prepare_cast(
    geometry: Geometry, visible: wp.array, rays: Rays, limit: float, cull: int, hits: HitArrays
) -> list[Callable[[], object]]:
    """The launches of a `cast` into these hits, for as often as it is wanted.

    They cast at shapes that stand still as they do by then, and at shapes that move as they do now; by as many threads
    as there are now.
    """
    device = rays.directions.device
    placed = geometry if geometry.instants == 1 else at_firings(geometry, rays)
    held = wp.empty(1, dtype=Geometry, device=device)
    launches: list[Callable[[], object]] = [recorded(hold, 1, [placed, visible], [held], device)]
    how = [rays.arrays, limit, cull]
    if rays.packets is None:
        everything = wp.empty(0, dtype=int, device=device)
        return [*launches, _prepare_alone(held, everything, rays.total, how, hits)]
    packets, worlds = rays.packets, rays.worlds
    if packets.tiles.size:
        sizes = {PacketHits: thread_count() * PACKETS, Directions: thread_count() * PACKETS}
        scratch = [wp.empty(size, dtype=kind, device="cpu") for kind, size in sizes.items()]
        inputs = [worlds, placed, held, packets.tiles, packets.packets, *how, *scratch]
        launches.append(prepare_over_tiles(cast_packets, worlds * packets.tiles.size, inputs, [hits.out()]))
    if packets.singles.size:
        launches.append(_prepare_alone(held, packets.singles, worlds * packets.singles.size, how, hits))
    return launches


def _prepare_alone(
    held: wp.array, which: wp.array, count: int, how: list[Any], hits: HitArrays
) -> Callable[[], object]:
    """Cast so many rays one by one: all of them, or those that `which` names, in every world."""
    inputs, device = [count, held, which, *how], hits.distance.device
    if device.is_cpu:
        return prepare_over_tiles(cast_turns, -(-count // RAYS_PER_RUN), inputs, [hits.out()])
    return prepare_over_rays(cast_rays, count, inputs, [hits.out()], device)
