"""Packets of rays from one origin through both levels of the geometry.

A *packet* is LANES neighbouring rays, a *tile* PACKETS neighbouring packets. A tile has a basis: an axis a and, across
it, u and v. Every ray of it runs along a + p u + q v with its own p and q, so in the frame of a tree, turned once for
the whole tile, what concerns a ray's direction is a linear function of (1, p, q).

The tree over the shapes is walked by whole tiles, the triangles of a shape by packets; boxes are held against the four
side planes of the rays, not against the rays. For a triangle with vertices V0, V1, V2 as seen from the origin, the side
of an edge on which a ray passes is s = c . (a + p u + q v), c = (Vi - Vj) x (Vi + Vj) (see rigcast.kernels.triangle).
The products c . a, c . u and c . v serve all rays of the packet.

Rounding, u = eps / 2, e = Vi - Vj, m = Vi + Vj: one of e, three of m, one each of the products and of the difference of
c, one of a, and three of the dot product make 10u |e|_1 |m|_1 for each of the three products; p and q have one each,
their products one, the two sums two: s is within 14u |e|_1 (|Vi|_1 + |Vj|_1) (1 + |p| + |q|) of what it should be. 24u
are allowed for. The distance V0 . n / ((a + p u + q v) . n) |a + p u + q v| has 6u |V0| of its numerator and 12u t of
its denominator, over |cos|; 16u (|V| + t) / |cos| are allowed for. What is too near to call goes to float64, by
rigcast.kernels.hits.
"""

import warp as wp

from .geometry import Geometry, TriangleBlock
from .hits import APART, NO_SHAPE, Hit, WorldRay, decided
from .ray import box_margin
from .solids import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    PLANE,
    SHEET,
    SPHERE,
    box_interval,
    capsule_interval,
    cylinder_interval,
    ellipsoid_interval,
    first_hit,
    has_triangles,
    intersect_plane,
    sphere_interval,
)
from .traverse import Entered, traversal
from .tree import WIDTH, Node, vec8
from .triangle import CULL_FRONT, CULL_NONE, GRAZING
from .triangle import ROUNDING as HEIGHT_ROUNDING
from .vectors import larger, lowest_bit, norm1, smaller, to_double, to_float

LANES = wp.constant(16)
PACKETS = wp.constant(8)
SIDE_ROUNDING = wp.constant(12.0 * 2.0**-23)  # 24u
DISTANCE_ROUNDING = wp.constant(8.0 * 2.0**-23)  # 16u
TINY = wp.constant(1.0e-30)

lanes = wp.types.vector(length=16, dtype=wp.float32)
int_lanes = wp.types.vector(length=16, dtype=wp.int32)
double_lanes = wp.types.vector(length=16, dtype=wp.float64)


@wp.struct
class Tile:
    """The basis of a tile, unit vectors in the rays' frame, and the packets' ranges of p and q."""

    axis: wp.vec3d
    u: wp.vec3d
    v: wp.vec3d
    p_low: vec8
    p_high: vec8
    q_low: vec8
    q_high: vec8
    packets: int  # bit by bit, which of the packets have rays


@wp.struct
class Packet:
    """Rays by their number, or -1, their unit directions in the rays' frame and their places in the tile.

    length is that of a + p u + q v.
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
class Directions:
    """Unit directions of a packet's rays in the world."""

    x: double_lanes
    y: double_lanes
    z: double_lanes


@wp.struct
class TileRays:
    """A tile of rays in the world, and where its hits are kept."""

    origin: wp.vec3d
    axis: wp.vec3d
    u: wp.vec3d
    v: wp.vec3d
    tile: Tile
    limit: float
    cull: int
    visible: wp.array[wp.bool]
    first_packet: int
    packets: wp.array[Packet]
    # PACKETS entries from first_slot on:
    first_slot: int
    best: wp.array[PacketHits]
    directions: wp.array[Directions]


@wp.struct
class View:
    """The origin and basis of a tile in the frame of a tree or shape."""

    origin: wp.vec3
    origin_rest: wp.vec3  # what is lost in rounding the origin to float32
    axis: wp.vec3
    u: wp.vec3
    v: wp.vec3
    margin: float  # by which boxes are widened, as for a single ray


@wp.struct
class Frustum:
    """Where rays of a range of p and q run: points x, as seen from the origin, with right . x <= 0 and so on."""

    origin: wp.vec3
    margin: float
    axis: wp.vec3
    left: wp.vec3
    right: wp.vec3
    bottom: wp.vec3
    top: wp.vec3
    slowness: wp.vec3  # 1 / the largest |component| of any of the unit directions


@wp.func
def view_from(origin: wp.vec3d, to_local: wp.mat33d, rays: TileRays, reach: float) -> View:
    """A tile as seen in a frame, with the ray's origin there, whose coordinates go up to reach."""
    view = View()
    view.origin = to_float(origin)
    view.origin_rest = to_float(origin - to_double(view.origin))
    view.axis = to_float(to_local * rays.axis)
    view.u = to_float(to_local * rays.u)
    view.v = to_float(to_local * rays.v)
    view.margin = box_margin(view.origin, reach)
    return view


@wp.func
def frustum_of(view: View, p_low: float, p_high: float, q_low: float, q_high: float) -> Frustum:
    f = Frustum()
    f.origin = view.origin
    f.margin = view.margin
    f.axis = view.axis
    f.left = p_low * view.axis - view.u
    f.right = view.u - p_high * view.axis
    f.bottom = q_low * view.axis - view.v
    f.top = view.v - q_high * view.axis
    middle = wp.abs(view.axis + 0.5 * (p_low + p_high) * view.u + 0.5 * (q_low + q_high) * view.v)
    # the length of a + p u + q v is at least 1
    most = middle + 0.5 * (p_high - p_low) * wp.abs(view.u) + 0.5 * (q_high - q_low) * wp.abs(view.v)
    f.slowness = wp.vec3(0.9999 / (most[0] + TINY), 0.9999 / (most[1] + TINY), 0.9999 / (most[2] + TINY))
    return f


@wp.func
def off_zero(a: wp.vec3) -> wp.vec3:
    """|a|, never 0, for products with half sizes that may be infinite."""
    return wp.abs(a) + wp.vec3(TINY, TINY, TINY)


@wp.func
def weighted(a: wp.vec3, x: float, y: float, z: float) -> float:
    return a[0] * x + a[1] * y + a[2] * z


@wp.func
def enter_frustum(node: Node, f: Frustum, limit: float) -> Entered:
    """The boxes that reach into the frustum no farther than the limit."""
    center_x = node.center_x
    center_y = node.center_y
    center_z = node.center_z
    half_x = node.half_x
    half_y = node.half_y
    half_z = node.half_z
    origin = f.origin
    margin = f.margin
    axis = f.axis
    left = f.left
    right = f.right
    bottom = f.bottom
    top = f.top
    slowness = f.slowness
    axis_size = off_zero(axis)
    left_size = off_zero(left)
    right_size = off_zero(right)
    bottom_size = off_zero(bottom)
    top_size = off_zero(top)
    distance = vec8()
    children = int(0)
    for j in range(WIDTH):
        x = center_x[j] - origin[0]
        y = center_y[j] - origin[1]
        z = center_z[j] - origin[2]
        hx = half_x[j] + margin
        hy = half_y[j] + margin
        hz = half_z[j] + margin
        ahead = weighted(axis, x, y, z) + weighted(axis_size, hx, hy, hz)
        off_left = weighted(left, x, y, z) - weighted(left_size, hx, hy, hz)
        off_right = weighted(right, x, y, z) - weighted(right_size, hx, hy, hz)
        off_bottom = weighted(bottom, x, y, z) - weighted(bottom_size, hx, hy, hz)
        off_top = weighted(top, x, y, z) - weighted(top_size, hx, hy, hz)
        outside = larger(larger(off_left, off_right), larger(off_bottom, off_top))
        near_xy = larger((wp.abs(x) - hx) * slowness[0], (wp.abs(y) - hy) * slowness[1])
        near = larger(near_xy, larger((wp.abs(z) - hz) * slowness[2], 0.0))
        distance[j] = near
        enters = outside <= 0.0 and ahead >= 0.0 and near <= limit and half_x[j] >= 0.0
        children = children | wp.where(enters, 1 << j, 0)
    entered = Entered()
    entered.children = children
    entered.distance = distance
    return entered


@wp.func
def packets_at_box(view: View, tile: Tile, center: wp.vec3, half: wp.vec3, distance: float, reach: vec8) -> int:
    """Bit by bit, the packets whose frusta a box in the view's frame reaches into, and whose reach is beyond it."""
    p_low = tile.p_low
    p_high = tile.p_high
    q_low = tile.q_low
    q_high = tile.q_high
    axis = view.axis
    u = view.u
    v = view.v
    to_center = center - view.origin
    h = half + wp.vec3(view.margin, view.margin, view.margin)
    at_axis = wp.dot(to_center, axis)
    at_u = wp.dot(to_center, u)
    at_v = wp.dot(to_center, v)
    packets = int(0)
    for j in range(PACKETS):
        left = wp.abs(p_low[j] * axis - u)
        right = wp.abs(u - p_high[j] * axis)
        bottom = wp.abs(q_low[j] * axis - v)
        top = wp.abs(v - q_high[j] * axis)
        # infinite boxes make NaN of 0 * inf, which is not outside
        outside = wp.where(p_low[j] * at_axis - at_u - weighted(left, h[0], h[1], h[2]) > 0.0, 1, 0)
        outside |= wp.where(at_u - p_high[j] * at_axis - weighted(right, h[0], h[1], h[2]) > 0.0, 1, 0)
        outside |= wp.where(q_low[j] * at_axis - at_v - weighted(bottom, h[0], h[1], h[2]) > 0.0, 1, 0)
        outside |= wp.where(at_v - q_high[j] * at_axis - weighted(top, h[0], h[1], h[2]) > 0.0, 1, 0)
        outside |= wp.where(distance <= reach[j], 0, 1)
        packets = packets | wp.where(outside == 0, 1 << j, 0)
    return packets & tile.packets


@wp.func
def farthest(far: lanes) -> float:
    half = vec8()
    for j in range(8):
        half[j] = larger(far[j], far[j + 8])
    return larger(
        larger(larger(half[0], half[1]), larger(half[2], half[3])),
        larger(larger(half[4], half[5]), larger(half[6], half[7])),
    )


@wp.func
def world_ray(rays: TileRays, slot: int, i: int) -> WorldRay:
    """The ray of lane i of a packet."""
    ray = WorldRay()
    ray.origin = rays.origin
    ray.direction = wp.vec3d(rays.directions[slot].x[i], rays.directions[slot].y[i], rays.directions[slot].z[i])
    ray.limit = rays.limit
    ray.cull = rays.cull
    return ray


@wp.func
def hit_of_lane(hits: PacketHits, i: int) -> Hit:
    hit = Hit()
    hit.near = hits.near[i]
    hit.far = hits.far[i]
    hit.shape = hits.shape[i]
    hit.triangle = hits.triangle[i]
    return hit


@wp.func
def offer(
    g: Geometry, rays: TileRays, slot: int, near: lanes, far: lanes, shape: int, triangle: int, reach: float
) -> float:
    """Let a packet's rays take the hits (near, far) of one shape or triangle where they are first; return its reach."""
    best_near = rays.best[slot].near
    best_far = rays.best[slot].far
    best_shape = rays.best[slot].shape
    best_triangle = rays.best[slot].triangle
    nearer = int(0)
    open = int(0)
    for i in range(LANES):
        is_nearer = wp.where(far[i] * APART < best_near[i], 1, 0)
        is_open = wp.where(near[i] <= best_far[i] * APART, 1 - is_nearer, 0) & wp.where(near[i] < wp.inf, 1, 0)
        best_near[i] = wp.where(is_nearer == 1, near[i], best_near[i])
        best_far[i] = wp.where(is_nearer == 1, far[i], best_far[i])
        best_shape[i] = wp.where(is_nearer == 1, shape, best_shape[i])
        best_triangle[i] = wp.where(is_nearer == 1, triangle, best_triangle[i])
        nearer = nearer | is_nearer
        open = open | (is_open << i)
    if nearer == 0 and open == 0:
        return reach
    rays.best[slot].near = best_near
    rays.best[slot].far = best_far
    rays.best[slot].shape = best_shape
    rays.best[slot].triangle = best_triangle
    while open != 0:
        i = lowest_bit(open)
        open = open & (open - 1)
        decide_lane_of_packet(g, rays, slot, i, near[i], far[i], shape, triangle)
    return APART * farthest(rays.best[slot].far)


@wp.func
def decide_lane_of_packet(
    g: Geometry, rays: TileRays, slot: int, i: int, near: float, far: float, shape: int, triangle: int
) -> None:
    hit = Hit()
    hit.near = near
    hit.far = far
    hit.shape = shape
    hit.triangle = triangle
    hits = rays.best[slot]
    first = decided(g, hit_of_lane(hits, i), hit, world_ray(rays, slot, i))
    hits.near[i] = first.near
    hits.far[i] = first.far
    hits.shape[i] = first.shape
    hits.triangle[i] = first.triangle
    rays.best[slot] = hits


@wp.struct
class Edges:
    """What the triangles of a block are to the rays of a tile: linear functions of (1, p, q), and their rounding."""

    side0_a: vec8
    side0_u: vec8
    side0_v: vec8
    side1_a: vec8
    side1_u: vec8
    side1_v: vec8
    side2_a: vec8
    side2_u: vec8
    side2_v: vec8
    slope_a: vec8
    slope_u: vec8
    slope_v: vec8
    rounding: vec8
    height: vec8
    reach: vec8
    possible: int  # bit by bit, which of the triangles any ray of the packet may hit


@wp.struct
class PacketRays:
    """A packet as the triangles of one shape see it."""

    rays: TileRays
    slot: int
    packet: int
    shape: int
    cull: int
    view: View
    frustum: Frustum
    p: float
    q: float
    p_half: float
    q_half: float


@wp.func
def edges_of(block: TriangleBlock, packet: PacketRays) -> Edges:
    x0 = block.x0
    y0 = block.y0
    z0 = block.z0
    x1 = block.x1
    y1 = block.y1
    z1 = block.z1
    x2 = block.x2
    y2 = block.y2
    z2 = block.z2
    normal_x = block.normal_x
    normal_y = block.normal_y
    normal_z = block.normal_z
    origin = packet.view.origin
    rest = packet.view.origin_rest
    a = packet.view.axis
    u = packet.view.u
    v = packet.view.v
    p = packet.p
    q = packet.q
    p_half = packet.p_half
    q_half = packet.q_half
    scale = SIDE_ROUNDING * (1.0 + wp.abs(p) + p_half + wp.abs(q) + q_half)
    s0a = vec8()
    s0u = vec8()
    s0v = vec8()
    s1a = vec8()
    s1u = vec8()
    s1v = vec8()
    s2a = vec8()
    s2u = vec8()
    s2v = vec8()
    na = vec8()
    nu = vec8()
    nv = vec8()
    rounding = vec8()
    height = vec8()
    reach = vec8()
    possible = int(0)
    for j in range(WIDTH):
        w0 = wp.vec3(x0[j], y0[j], z0[j])
        w1 = wp.vec3(x1[j], y1[j], z1[j])
        w2 = wp.vec3(x2[j], y2[j], z2[j])
        v0 = (w0 - origin) - rest
        v1 = (w1 - origin) - rest
        v2 = (w2 - origin) - rest
        e0 = w0 - w1
        e1 = w1 - w2
        e2 = w2 - w0
        c0 = wp.cross(e0, v0 + v1)
        c1 = wp.cross(e1, v1 + v2)
        c2 = wp.cross(e2, v2 + v0)
        n = wp.vec3(normal_x[j], normal_y[j], normal_z[j])
        size0 = norm1(v0)
        size1 = norm1(v1)
        size2 = norm1(v2)
        side = larger(norm1(e0) * (size0 + size1), larger(norm1(e1) * (size1 + size2), norm1(e2) * (size2 + size0)))
        r = scale * side
        s0a[j] = wp.dot(c0, a)
        s0u[j] = wp.dot(c0, u)
        s0v[j] = wp.dot(c0, v)
        s1a[j] = wp.dot(c1, a)
        s1u[j] = wp.dot(c1, u)
        s1v[j] = wp.dot(c1, v)
        s2a[j] = wp.dot(c2, a)
        s2u[j] = wp.dot(c2, u)
        s2v[j] = wp.dot(c2, v)
        na[j] = wp.dot(n, a)
        nu[j] = wp.dot(n, u)
        nv[j] = wp.dot(n, v)
        rounding[j] = r
        height[j] = wp.dot(v0, n)
        reach[j] = larger(size0, larger(size1, size2))
        # the sides at the middle of the packet, and how much they change to its corners
        m0 = s0a[j] + p * s0u[j] + q * s0v[j]
        m1 = s1a[j] + p * s1u[j] + q * s1v[j]
        m2 = s2a[j] + p * s2u[j] + q * s2v[j]
        d0 = p_half * wp.abs(s0u[j]) + q_half * wp.abs(s0v[j]) + r
        d1 = p_half * wp.abs(s1u[j]) + q_half * wp.abs(s1v[j]) + r
        d2 = p_half * wp.abs(s2u[j]) + q_half * wp.abs(s2v[j]) + r
        left = smaller(m0 + d0, smaller(m1 + d1, m2 + d2)) >= 0.0
        right = larger(m0 - d0, larger(m1 - d1, m2 - d2)) <= 0.0
        possible = possible | wp.where(left or right, 1 << j, 0)
    edges = Edges()
    edges.side0_a = s0a
    edges.side0_u = s0u
    edges.side0_v = s0v
    edges.side1_a = s1a
    edges.side1_u = s1u
    edges.side1_v = s1v
    edges.side2_a = s2a
    edges.side2_u = s2u
    edges.side2_v = s2v
    edges.slope_a = na
    edges.slope_u = nu
    edges.slope_v = nv
    edges.rounding = rounding
    edges.height = height
    edges.reach = reach
    edges.possible = possible
    return edges


@wp.func
def visit_block_of_packet(g: Geometry, packet: PacketRays, index: int, distance: float, reach: float) -> float:  # noqa: ARG001
    """A packet against the triangles of one block; returns how far its rays still reach."""
    edges = edges_of(g.blocks[index], packet)
    possible = edges.possible
    while possible != 0:
        j = lowest_bit(possible)
        possible = possible & (possible - 1)
        reach = visit_triangle(g, packet, edges, j, index * WIDTH + j, reach)
    return reach


@wp.func
def visit_triangle(g: Geometry, packet: PacketRays, edges: Edges, j: int, triangle: int, reach: float) -> float:
    """A packet against one triangle, as triage_triangle has it."""
    p = packet.rays.packets[packet.packet].p
    q = packet.rays.packets[packet.packet].q
    length = packet.rays.packets[packet.packet].length
    cull = packet.cull
    a0 = edges.side0_a[j]
    u0 = edges.side0_u[j]
    v0 = edges.side0_v[j]
    a1 = edges.side1_a[j]
    u1 = edges.side1_u[j]
    v1 = edges.side1_v[j]
    a2 = edges.side2_a[j]
    u2 = edges.side2_u[j]
    v2 = edges.side2_v[j]
    na = edges.slope_a[j]
    nu = edges.slope_u[j]
    nv = edges.slope_v[j]
    rounding = edges.rounding[j]
    height = edges.height[j]
    size = edges.reach[j]
    is_high = wp.where(wp.abs(height) > HEIGHT_ROUNDING * size, 1, 0)
    near = lanes()
    far = lanes()
    some = int(0)
    # conditions are numbers: a loop with `and` and `or` is not vectorised
    for i in range(LANES):
        s0 = a0 + p[i] * u0 + q[i] * v0
        s1 = a1 + p[i] * u1 + q[i] * v1
        s2 = a2 + p[i] * u2 + q[i] * v2
        inside = larger(smaller(s0, smaller(s1, s2)), -larger(s0, larger(s1, s2)))
        slope = na + p[i] * nu + q[i] * nv
        per_slope = length[i] / slope
        t = height * per_slope
        error = DISTANCE_ROUNDING * (size + wp.abs(t)) * wp.abs(per_slope)
        is_sure = wp.where(inside > rounding, 1, 0) & wp.where(wp.abs(per_slope) < 1.0 / GRAZING, is_high, 0)
        is_dropped = is_sure & (wp.where(t < 0.0, 1, 0) | wp.where(slope * float(cull) > 0.0, 1, 0))
        is_hit = wp.where(inside >= -rounding, 1 - is_dropped, 0)
        near[i] = wp.where(is_hit == 1, wp.where(is_sure == 1, t - error, 0.0), wp.inf)
        far[i] = wp.where(is_hit & is_sure == 1, t + error, wp.inf)
        some = some | is_hit
    if some == 0:
        return reach
    return offer(g, packet.rays, packet.slot, near, far, packet.shape, triangle, reach)


@wp.func
def enter_of_packet(node: Node, packet: PacketRays, reach: float) -> Entered:
    return enter_frustum(node, packet.frustum, smaller(reach, packet.rays.limit))


@wp.func
def reach_of_packet(reach: float) -> float:
    return reach


cast_packet_through_triangles = traversal(
    "cast_packet_through_triangles", PacketRays, float, enter_of_packet, reach_of_packet, visit_block_of_packet
)


@wp.func
def packet_rays(rays: TileRays, view: View, k: int, shape: int, cull: int) -> PacketRays:
    """Packet k of a tile as one shape sees it."""
    tile = rays.tile
    packet = PacketRays()
    packet.rays = rays
    packet.slot = rays.first_slot + k
    packet.packet = rays.first_packet + k
    packet.shape = shape
    packet.cull = cull
    packet.view = view
    packet.frustum = frustum_of(view, tile.p_low[k], tile.p_high[k], tile.q_low[k], tile.q_high[k])
    packet.p = 0.5 * (tile.p_low[k] + tile.p_high[k])
    packet.q = 0.5 * (tile.q_low[k] + tile.q_high[k])
    packet.p_half = 0.5 * (tile.p_high[k] - tile.p_low[k])
    packet.q_half = 0.5 * (tile.q_high[k] - tile.q_low[k])
    return packet


@wp.func
def visit_closed_form(
    g: Geometry, rays: TileRays, slot: int, shape: int, to_local: wp.mat33d, origin: wp.vec3, reach: float
) -> float:
    """A packet against one closed form: lane by lane what a single ray does."""
    x = rays.directions[slot].x
    y = rays.directions[slot].y
    z = rays.directions[slot].z
    kind = g.kind[shape]
    size = g.size[shape]
    cull = rays.cull
    dx = lanes()
    dy = lanes()
    dz = lanes()
    t = lanes()
    for i in range(LANES):
        d = to_float(to_local * wp.vec3d(x[i], y[i], z[i]))
        dx[i] = d[0]
        dy[i] = d[1]
        dz[i] = d[2]
    if kind == PLANE:
        for i in range(LANES):
            t[i] = intersect_plane(origin, wp.vec3(dx[i], dy[i], dz[i]), size, cull)
    elif kind == SPHERE:
        for i in range(LANES):
            t[i] = first_hit(sphere_interval(origin, wp.vec3(dx[i], dy[i], dz[i]), size[0]), cull)
    elif kind == CAPSULE:
        for i in range(LANES):
            t[i] = first_hit(capsule_interval(origin, wp.vec3(dx[i], dy[i], dz[i]), size[0], size[1]), cull)
    elif kind == ELLIPSOID:
        for i in range(LANES):
            t[i] = first_hit(ellipsoid_interval(origin, wp.vec3(dx[i], dy[i], dz[i]), size), cull)
    elif kind == CYLINDER:
        for i in range(LANES):
            t[i] = first_hit(cylinder_interval(origin, wp.vec3(dx[i], dy[i], dz[i]), size[0], size[1]), cull)
    elif kind == BOX:
        for i in range(LANES):
            t[i] = first_hit(box_interval(origin, wp.vec3(dx[i], dy[i], dz[i]), size), cull)
    return offer(g, rays, slot, t, t, shape, 0, reach)


@wp.struct
class TileSought:
    """A tile of rays, and the frustum of all of it in the frame of the tree over the shapes."""

    rays: TileRays
    frustum: Frustum


@wp.func
def visit_shape_of_tile(g: Geometry, sought: TileSought, shape: int, distance: float, reach: vec8) -> vec8:
    """A tile against one shape, if it is visible; returns how far its packets still reach."""
    rays = sought.rays
    kind = g.kind[shape]
    if not rays.visible[shape] or (kind == SHEET and rays.cull == CULL_FRONT):
        return reach
    to_local = wp.transpose(g.rotation[shape])
    view = view_from(to_local * (rays.origin - g.position[shape]), to_local, rays, g.reach[shape])
    packets = packets_at_box(view, rays.tile, g.center[shape], g.half[shape], distance, reach)
    cull = wp.where(kind == SHEET, CULL_NONE, rays.cull)
    while packets != 0:
        k = lowest_bit(packets)
        packets = packets & (packets - 1)
        if has_triangles(kind):
            packet = packet_rays(rays, view, k, shape, cull)
            reach[k] = cast_packet_through_triangles(g, g.nodes, g.root[shape], packet, reach[k])
        else:
            reach[k] = visit_closed_form(g, rays, rays.first_slot + k, shape, to_local, view.origin, reach[k])
    return reach


@wp.func
def enter_of_tile(node: Node, sought: TileSought, reach: float) -> Entered:
    return enter_frustum(node, sought.frustum, smaller(reach, sought.rays.limit))


@wp.func
def reach_of_tile(reach: vec8) -> float:
    return larger(
        larger(larger(reach[0], reach[1]), larger(reach[2], reach[3])),
        larger(larger(reach[4], reach[5]), larger(reach[6], reach[7])),
    )


cast_tile_through_shapes = traversal(
    "cast_tile_through_shapes", TileSought, vec8, enter_of_tile, reach_of_tile, visit_shape_of_tile
)


@wp.func
def clear_packet(rays: TileRays, k: int, rotation: wp.mat33d) -> None:
    """No hits yet, and the directions of a packet's rays in the world."""
    packet = rays.packets[rays.first_packet + k]
    x = packet.x
    y = packet.y
    z = packet.z
    world_x = double_lanes()
    world_y = double_lanes()
    world_z = double_lanes()
    hits = PacketHits()
    for i in range(LANES):
        d = rotation * wp.vec3d(x[i], y[i], z[i])
        world_x[i] = d[0]
        world_y[i] = d[1]
        world_z[i] = d[2]
        hits.near[i] = wp.inf
        hits.far[i] = wp.inf
        hits.shape[i] = NO_SHAPE
    rays.best[rays.first_slot + k] = hits
    rays.directions[rays.first_slot + k].x = world_x
    rays.directions[rays.first_slot + k].y = world_y
    rays.directions[rays.first_slot + k].z = world_z


@wp.func
def cast_tile(g: Geometry, rays: TileRays) -> None:
    """The first hits of a tile's rays among the visible shapes, into its slots; they may lie beyond the limit."""
    tile = rays.tile
    p_low = float(wp.inf)
    p_high = float(-wp.inf)
    q_low = float(wp.inf)
    q_high = float(-wp.inf)
    reach = vec8()
    for k in range(PACKETS):
        reach[k] = -wp.inf
        if tile.packets & (1 << k) != 0:
            reach[k] = wp.inf
            p_low = wp.min(p_low, tile.p_low[k])
            p_high = wp.max(p_high, tile.p_high[k])
            q_low = wp.min(q_low, tile.q_low[k])
            q_high = wp.max(q_high, tile.q_high[k])
    identity = wp.mat33d(
        wp.float64(1.0),
        wp.float64(0.0),
        wp.float64(0.0),
        wp.float64(0.0),
        wp.float64(1.0),
        wp.float64(0.0),
        wp.float64(0.0),
        wp.float64(0.0),
        wp.float64(1.0),
    )
    sought = TileSought()
    sought.rays = rays
    view = view_from(rays.origin - g.anchor[0], identity, rays, g.top_reach[0])
    sought.frustum = frustum_of(view, p_low, p_high, q_low, q_high)
    cast_tile_through_shapes(g, g.top, 0, sought, reach)
