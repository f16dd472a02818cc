"""A tile of rays, its packets, and the best hits of their rays so far."""

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.hits.hit import APART, Hit, WorldRay, decided, hit_within
from rigcast.kernels.hits.out import Fields
from rigcast.kernels.inline import inlined, noinline
from rigcast.kernels.poses.scope import Scope
from rigcast.kernels.single.ray import box_margin
from rigcast.kernels.trees.nodes import Node, vec8, vec8i
from rigcast.kernels.vectors import larger, lowest_bit, to_double, to_float

LANES = wp.constant(16)
PACKETS = wp.constant(8)
TILE = wp.constant(LANES * PACKETS)
ALL_LANES = wp.constant(2**16 - 1)

lanes = wp.types.vector(length=16, dtype=wp.float32)
int_lanes = wp.types.vector(length=16, dtype=wp.int32)
double_lanes = wp.types.vector(length=16, dtype=wp.float64)


@wp.struct
class Tile:
    """A tile's basis (unit vectors in the rays' frame) and the ranges of p and q of its packets."""

    axis: wp.vec3d
    u: wp.vec3d
    v: wp.vec3d
    p_low: vec8
    p_high: vec8
    q_low: vec8
    q_high: vec8
    packets: int  # bit mask of the packets that have rays
    ray: int  # number of one ray of the tile; all share its firing and origin
    across: int  # packets side by side (1 or 4) that each of the PACKETS rows of LANES rays spans; 0 if without rows
    rows: vec8i  # number of the first ray of each row; the others follow it


@wp.struct
class Packet:
    """The rays of a packet.

    ray: its number, -1 for none. x, y, z: unit direction in the rays' frame. length: of a + p u + q v.
    """

    ray: int_lanes
    x: double_lanes
    y: double_lanes
    z: double_lanes
    p: lanes
    q: lanes
    length: lanes


@wp.struct
class PacketHits:
    """The best hit of every ray of a packet, as in Hit."""

    near: lanes
    far: lanes
    shape: int_lanes
    triangle: int_lanes


@wp.struct
class Vectors:
    """A vector for every ray of a packet."""

    x: lanes
    y: lanes
    z: lanes


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native("""
    auto* to = wp::address(rounded, 0);
#if defined(__CUDA_ARCH__)
    // not float(x), which is a macro of Warp's
    for (int i = 0; i < 16; ++i) {
        to->x[i] = (float)x[i];
        to->y[i] = (float)y[i];
        to->z[i] = (float)z[i];
    }
#else
    typedef double doubles __attribute__((ext_vector_type(16)));
    typedef float floats __attribute__((ext_vector_type(16)));
    doubles values[3];
    __builtin_memcpy(&values[0], &x, sizeof(x));
    __builtin_memcpy(&values[1], &y, sizeof(y));
    __builtin_memcpy(&values[2], &z, sizeof(z));
    floats converted[3];
    for (int k = 0; k < 3; ++k) converted[k] = __builtin_convertvector(values[k], floats);
    __builtin_memcpy(&to->x, &converted[0], sizeof(to->x));
    __builtin_memcpy(&to->y, &converted[1], sizeof(to->y));
    __builtin_memcpy(&to->z, &converted[2], sizeof(to->z));
#endif
""")
def round_vectors(rounded: wp.array[Vectors], x: double_lanes, y: double_lanes, z: double_lanes):  # type: ignore[no-untyped-def]
    """Round to float32 in whole vectors. A loop over float64 stores half vectors; loading two as one would stall."""


@wp.struct
class Directions:
    """Unit directions of a packet's rays in the world."""

    x: double_lanes
    y: double_lanes
    z: double_lanes


@wp.struct
class Facets:
    """The plane of the triangle that each ray hits, in the shape's frame: normal n, not of unit length, height V0 . n;
    and the number of its face."""

    height: double_lanes
    normal_x: double_lanes
    normal_y: double_lanes
    normal_z: double_lanes
    face: int_lanes


@wp.struct
class TileRays:
    """A tile of rays in the world, and its scratch. Passed in an array of one: Warp copies structs passed by value."""

    start: wp.vec3d  # the origin in the rays' frame
    origin: wp.vec3d
    rotation: wp.mat33d  # columns: the axes of the rays' frame
    axis: wp.vec3d
    u: wp.vec3d
    v: wp.vec3d
    tile: Tile
    scope: Scope
    limit: float
    cull: int
    met: int  # bit mask of the packets that have met a shape; the slots of the others are not initialised
    first_ray: int  # of the tile's world
    first_packet: int
    packets: wp.array[Packet]
    geometry: wp.array[Geometry]
    first_slot: int  # this thread's first of PACKETS slots in `best` and `directions`
    best: wp.array[PacketHits]
    directions: wp.array[Directions]
    local: wp.array[Vectors]  # (1,) scratch, such as a packet's directions in a shape's frame
    opened: wp.array[Node]  # (1,) the node of a plot
    composed: wp.array[TriangleBlock]  # (1,) the triangles of a patch
    plot: int  # number of the plot in `opened`, -1 for none; kept because neighbours often need the same
    patch: int  # number of the patch in `composed`, -1 for none
    facets: wp.array[Facets]  # (1,) the planes that a packet hits on a shape
    fields: Fields


@wp.struct
class PacketRays:
    """One packet of a tile and the slot of its hits. Kept small: functions copy the structs passed to them."""

    tile: wp.array[TileRays]
    packet: int
    slot: int
    best: wp.array[PacketHits]


@wp.struct
class View:
    """The origin and basis of a tile in the frame of a tree or shape."""

    origin: wp.vec3
    origin_rest: wp.vec3  # what rounding the origin to float32 loses
    axis: wp.vec3
    u: wp.vec3
    v: wp.vec3
    margin: float  # by which boxes are widened [m], as for a single ray


@wp.func
def view_from(origin: wp.vec3d, to_local: wp.mat33d, rays: wp.array[TileRays], reach: float) -> View:
    """A tile in a local frame. origin: of the rays, in that frame. reach: the largest coordinate there [m]."""
    view = View()
    view.origin = to_float(origin)
    view.origin_rest = to_float(origin - to_double(view.origin))
    view.axis = to_float(to_local * rays[0].axis)
    view.u = to_float(to_local * rays[0].u)
    view.v = to_float(to_local * rays[0].v)
    view.margin = box_margin(view.origin, reach)
    return view


@inlined
def max_of_lanes(a: lanes) -> float:
    """The largest of sixteen numbers of either sign."""
    half = vec8()
    for j in range(8):
        half[j] = larger(a[j], a[j + 8])
    return larger(
        larger(larger(half[0], half[1]), larger(half[2], half[3])),
        larger(larger(half[4], half[5]), larger(half[6], half[7])),
    )


@wp.func
def world_ray(rays: wp.array[TileRays], slot: int, i: int) -> WorldRay:
    """The ray of lane i of a packet."""
    directions = rays[0].directions
    ray = WorldRay()
    ray.origin = rays[0].origin
    ray.direction = wp.vec3d(directions[slot].x[i], directions[slot].y[i], directions[slot].z[i])
    ray.scope = rays[0].scope
    ray.limit = rays[0].limit
    ray.cull = rays[0].cull
    return ray


@wp.func
def axis_ray(rays: wp.array[TileRays]) -> WorldRay:
    """The ray along a tile's axis; it is finite if the tile's rays are."""
    ray = WorldRay()
    ray.origin = rays[0].origin
    ray.direction = rays[0].axis
    return ray


@wp.func
def packet_of(rays: wp.array[TileRays], k: int) -> PacketRays:
    """Packet k of a tile."""
    packet = PacketRays()
    packet.tile = rays
    packet.packet = rays[0].first_packet + k
    packet.slot = rays[0].first_slot + k
    packet.best = rays[0].best
    return packet


@wp.func
def hit_of_lane(hits: PacketHits, i: int) -> Hit:
    return hit_within(hits.near[i], hits.far[i], hits.shape[i], hits.triangle[i])


@inlined
def offer(packet: PacketRays, near: lanes, far: lanes, shape: int, triangle: int, reach: float) -> float:
    """Offer hits at distances [near, far] on one shape or triangle to a packet's rays; each keeps the first of the two.

    Where the intervals overlap, float64 decides. Returns the packet's new reach [m].
    """
    slot = packet.slot
    best_near = packet.best[slot].near
    best_far = packet.best[slot].far
    best_shape = packet.best[slot].shape
    best_triangle = packet.best[slot].triangle
    nearer = int(0)
    open = int(0)
    for i in range(LANES):
        is_nearer = wp.where(far[i] * APART < best_near[i], 1, 0)
        is_open = wp.where(near[i] <= best_far[i] * APART, 1 - is_nearer, 0) & wp.where(near[i] < wp.inf, 1, 0)
        best_near[i] = wp.where(is_nearer == 1, near[i], best_near[i])
        best_far[i] = wp.where(is_nearer == 1, far[i], best_far[i])
        # in place of wp.where, which becomes masked stores that take longer than all else here; no number is below 0
        kept = is_nearer - 1
        best_shape[i] = wp.max(best_shape[i] & kept, shape & ~kept)
        best_triangle[i] = wp.max(best_triangle[i] & kept, triangle & ~kept)
        nearer = nearer | is_nearer
        open = open | (is_open << i)
    if nearer == 0 and open == 0:
        return reach
    packet.best[slot].near = best_near
    packet.best[slot].far = best_far
    packet.best[slot].shape = best_shape
    packet.best[slot].triangle = best_triangle
    while open != 0:
        i = lowest_bit(open)
        open = open & (open - 1)
        decide_lane_of_packet(packet.tile, slot, i, near[i], far[i], shape, triangle)
    return APART * max_of_lanes(packet.best[slot].far)


@noinline
def decide_lane_of_packet(
    rays: wp.array[TileRays], slot: int, i: int, near: float, far: float, shape: int, triangle: int
) -> None:
    """Decide in float64 between the best hit of lane i of a packet and another hit; keep the first."""
    hit = hit_within(near, far, shape, triangle)
    hits = rays[0].best[slot]
    first = decided(rays[0].geometry, hit_of_lane(hits, i), hit, world_ray(rays, slot, i))
    hits.near[i] = first.near
    hits.far[i] = first.far
    hits.shape[i] = first.shape
    hits.triangle[i] = first.triangle
    rays[0].best[slot] = hits
