"""Packets through the triangles of a shape.

Rounding, u = eps / 2, e = Vi - Vj, m = Vi + Vj: one of e, three of m, one each of the products and of the difference of
c, one of a, and three of the dot product make 10u |e|_1 |m|_1 for each of the three products; p and q have one each,
their products one, the two sums two: s is within 14u |e|_1 (|Vi|_1 + |Vj|_1) (1 + |p| + |q|) of what it should be. 24u
are allowed for. The distance V0 . n / ((a + p u + q v) . n) |a + p u + q v| has 6u |V0| of its numerator and 12u t of
its denominator, over |cos|; 16u (|V| + t) / |cos| are allowed for. What is too near to call goes to float64, by
rigcast.kernels.hits.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.traverse import Entered, traversal
from rigcast.kernels.tree import WIDTH, Node, vec8
from rigcast.kernels.triangle import GRAZING
from rigcast.kernels.triangle import ROUNDING as HEIGHT_ROUNDING
from rigcast.kernels.vectors import larger, lowest_bit, norm1, smaller

from .frustum import Frustum, enter_frustum, frustum_of
from .packet import LANES, TileRays, View, lanes, offer

SIDE_ROUNDING = wp.constant(12.0 * 2.0**-23)  # 24u
DISTANCE_ROUNDING = wp.constant(8.0 * 2.0**-23)  # 16u


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
def enter_of_packet(node: Node, packet: PacketRays, reach: float) -> Entered:
    return enter_frustum(node, packet.frustum, smaller(reach, packet.rays.limit))


@wp.func
def reach_of_packet(reach: float) -> float:
    return reach


cast_packet_through_triangles = traversal(
    "cast_packet_through_triangles", PacketRays, float, enter_of_packet, reach_of_packet, visit_block_of_packet
)
