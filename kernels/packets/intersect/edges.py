"""A packet against the triangles of one block: their edges, then their planes.

With the vertices relative to the ray's origin, a ray with unit direction d passes the edge from Vi to Vj on the side
given by the sign of s = d . (e x V), where e = Vi - Vj and V is either vertex. (This is half of the s in
rigcast.kernels.shapes.triangle.) e x V is computed once for all rays of the packet.

Rounding of s, in units u = eps / 2:

- e x V: one rounding of e, two of V, one of the products and one of their difference: 5u |e|_1 |V|_1.
- d = (a + p u + q v) / length: one rounding each of a, u, v, p and q, one of each product and two of the sums: 5u w,
  with w = 1 + |p| + |q|, over the length, which is at least w / sqrt(3). Length and quotient add 3u.
- The dot product adds 3u.

So the error of s is at most u (11 + 5 min(w, sqrt(3))) |e|_1 |V|_1. The code allows for 12 in place of 11.

Rounding of the distance t = V0 . n / (d . n):

- numerator: 5u |V0|;
- denominator: 7u t of d (below), 3u t of the length, 3u t of the dot product;
- n is off by at most 4u (rigcast.kernels.shapes.patches), which moves t by 4u (|V0| + t);
- quotient and product: 2u t; adding the error bound itself: u t.

Together 9u |V0| + 20u t, over |cos|. The code allows for 10u |V0| + 24u t. As a vector, a + p u + q v is off by u of a,
3u |p| and 3u |q|, because a, u and v are unit vectors, and by 2u of its length: over the length at most
(2 + sqrt(19)) u < 7u.

Hits too close to call are decided in float64, by rigcast.kernels.hits.hit.
"""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock
from rigcast.kernels.inline import inlined
from rigcast.kernels.packets.packet import LANES, View, lanes
from rigcast.kernels.shapes.triangle import GRAZING, ROUNDING, Spans, inside_edges
from rigcast.kernels.trees.nodes import WIDTH, vec8, vec8i
from rigcast.kernels.trees.traverse import sign_bits
from rigcast.kernels.vectors import Interval, interval, larger, norm1, smaller

from .frustum import weighted

SIDE_ROUNDING = wp.constant(6.0 * 2.0**-23)  # 12u
DIRECTION_ROUNDING = wp.constant(2.5 * 2.0**-23)  # 5u
MOST_ROUNDING = wp.constant(4.35 * 2.0**-23)  # more than 5 sqrt(3) u
HEIGHT_ROUNDING = wp.constant(5.0 * 2.0**-23)  # 10u
SLOPE_ROUNDING = wp.constant(12.0 * 2.0**-23)  # 24u


vectors = wp.types.matrix(shape=(3, 8), dtype=wp.float32)
"""One vector for each of eight triangles, as columns."""


@wp.struct
class Edges:
    """A block of triangles relative to a packet's origin.

    side0..2: e x V of each edge. normal: n. height: V0 . n. size: |V0|_1. rounding: bound on the error of s.
    """

    side0: vectors
    side1: vectors
    side2: vectors
    normal: vectors
    height: vec8
    size: vec8
    rounding: vec8


@wp.func
def side_rounding(widest: float) -> float:
    """Bound on the error of s, over |e|_1 |V|_1. widest: the largest w of a packet."""
    return SIDE_ROUNDING + smaller(DIRECTION_ROUNDING * widest, MOST_ROUNDING)


@inlined
def edges_of(block: TriangleBlock, view: View, rounding_of_sides: float) -> Edges:
    """The edges of a block's triangles relative to a packet's origin."""
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
    origin = view.origin
    rest = view.origin_rest
    side0 = vectors()
    side1 = vectors()
    side2 = vectors()
    normal = vectors()
    height = vec8()
    size = vec8()
    rounding = vec8()
    for j in range(WIDTH):
        w0 = wp.vec3(x0[j], y0[j], z0[j])
        w1 = wp.vec3(x1[j], y1[j], z1[j])
        w2 = wp.vec3(x2[j], y2[j], z2[j])
        n = wp.vec3(normal_x[j], normal_y[j], normal_z[j])
        v0 = (w0 - origin) - rest
        v1 = (w1 - origin) - rest
        e0 = w0 - w1
        e1 = w1 - w2
        e2 = w2 - w0
        s0 = wp.cross(e0, v0)
        s1 = wp.cross(e1, v1)
        s2 = wp.cross(e2, v0)
        for k in range(3):
            side0[k, j] = s0[k]
            side1[k, j] = s1[k]
            side2[k, j] = s2[k]
            normal[k, j] = n[k]
        size0 = norm1(v0)
        rounding[j] = rounding_of_sides * larger(larger(norm1(e0), norm1(e2)) * size0, norm1(e1) * norm1(v1))
        height[j] = wp.dot(v0, n)
        size[j] = size0
    edges = Edges()
    edges.side0 = side0
    edges.side1 = side1
    edges.side2 = side2
    edges.normal = normal
    edges.height = height
    edges.size = size
    edges.rounding = rounding
    return edges


@inlined
def may_be_hit(edges: Edges, middle: wp.vec3, spread: wp.vec3, widest: float) -> int:
    """Bit mask of the triangles that rays along middle +- spread may hit. widest: the largest w of a packet.

    Rounding, per w |e|_1 |V|_1: 5u of e x V; 6u of the middle (a mean, p, u and their product, two sums); 3u of its dot
    product; 1u of the sum with the change. Together 15u. The error of the spread is smaller. The code allows for at
    least 17u.
    """
    side0 = edges.side0
    side1 = edges.side1
    side2 = edges.side2
    rounding = edges.rounding
    possible = int(0)
    for j in range(WIDTH):
        middle0 = weighted(middle, side0[0, j], side0[1, j], side0[2, j])
        middle1 = weighted(middle, side1[0, j], side1[1, j], side1[2, j])
        middle2 = weighted(middle, side2[0, j], side2[1, j], side2[2, j])
        change0 = weighted(spread, wp.abs(side0[0, j]), wp.abs(side0[1, j]), wp.abs(side0[2, j]))
        change1 = weighted(spread, wp.abs(side1[0, j]), wp.abs(side1[1, j]), wp.abs(side1[2, j]))
        change2 = weighted(spread, wp.abs(side2[0, j]), wp.abs(side2[1, j]), wp.abs(side2[2, j]))
        allowed = widest * rounding[j]
        left = smaller(middle0 + change0, smaller(middle1 + change1, middle2 + change2)) >= -allowed
        right = larger(middle0 - change0, larger(middle1 - change1, middle2 - change2)) <= allowed
        possible = possible | wp.where(left or right, 1 << j, 0)
    return possible


@wp.func
def span_in_plane(inside: float, slope: float, rounding: float, height: float, size: float, cull: int) -> Interval:
    """Interval [near, far] of the distance from a ray to a triangle, with the meaning of triage_triangle's.

    Conditions are wp.where of distances: `and` and `or` prevent vectorisation, and wp.where of integers is slower.
    """
    # largest 1 / |slope| at which the distance is sure; 0, so never, where the origin is nearly in the plane
    steepest = wp.where(wp.abs(height) > ROUNDING * size, 1.0 / GRAZING, 0.0)
    per_slope = 1.0 / slope
    t = height * per_slope
    error = (HEIGHT_ROUNDING * size + SLOPE_ROUNDING * wp.abs(t)) * wp.abs(per_slope)
    is_dropped = larger(-t, slope * float(cull)) > 0.0
    sure_near = wp.where(is_dropped, wp.inf, t - error)
    sure_far = wp.where(is_dropped, wp.inf, t + error)
    is_steep = wp.abs(per_slope) < steepest
    hit_near = wp.where(inside > rounding, wp.where(is_steep, sure_near, 0.0), 0.0)
    near = wp.where(inside >= -rounding, hit_near, wp.inf)
    far = wp.where(inside > rounding, wp.where(is_steep, sure_far, wp.inf), wp.inf)
    return interval(near, far)


@inlined
def meet_triangles(edges: Edges, direction: wp.vec3, cull: int, limit: float) -> Spans:
    """Test one ray against the triangles of a block, up to a limit [m]."""
    side0 = edges.side0
    side1 = edges.side1
    side2 = edges.side2
    normal = edges.normal
    rounding = edges.rounding
    height = edges.height
    size = edges.size
    near = vec8()
    far = vec8()
    possible = vec8i()
    for j in range(WIDTH):
        s0 = weighted(direction, side0[0, j], side0[1, j], side0[2, j])
        s1 = weighted(direction, side1[0, j], side1[1, j], side1[2, j])
        s2 = weighted(direction, side2[0, j], side2[1, j], side2[2, j])
        slope = weighted(direction, normal[0, j], normal[1, j], normal[2, j])
        span = span_in_plane(inside_edges(s0, s1, s2), slope, rounding[j], height[j], size[j], cull)
        near[j] = span[0]
        far[j] = span[1]
        possible[j] = wp.where(span[0] <= limit, wp.where(span[0] < wp.inf, -1, 0), 0)
    spans = Spans()
    spans.near = near
    spans.far = far
    spans.possible = sign_bits(possible)
    return spans


@wp.struct
class Inside:
    """by: how far inside its nearest edge each ray passes a triangle. some: not 0 if any ray may pass through it."""

    by: lanes
    some: int


@inlined
def pass_edges(x: lanes, y: lanes, z: lanes, side0: wp.vec3, side1: wp.vec3, side2: wp.vec3, rounding: float) -> Inside:
    """Test the rays of a packet, with directions (x, y, z), against the edges of one triangle, as in Edges."""
    by = lanes()
    some = int(0)
    for i in range(LANES):
        s0 = weighted(side0, x[i], y[i], z[i])
        s1 = weighted(side1, x[i], y[i], z[i])
        s2 = weighted(side2, x[i], y[i], z[i])
        nearest = inside_edges(s0, s1, s2)
        by[i] = nearest
        some = some | wp.where(nearest >= -rounding, 1, 0)
    inside = Inside()
    inside.by = by
    inside.some = some
    return inside


@wp.struct
class Met:
    """Interval [near, far] of each ray's distance to a triangle."""

    near: lanes
    far: lanes


@inlined
def meet_plane(
    x: lanes,
    y: lanes,
    z: lanes,
    inside: lanes,
    normal: wp.vec3,
    rounding: float,
    height: float,
    size: float,
    cull: int,
) -> Met:
    """Intervals of the distances of a packet's rays to a triangle, as triage_triangle's. inside: see Inside.by."""
    near = lanes()
    far = lanes()
    for i in range(LANES):
        slope = weighted(normal, x[i], y[i], z[i])
        span = span_in_plane(inside[i], slope, rounding, height, size, cull)
        near[i] = span[0]
        far[i] = span[1]
    met = Met()
    met.near = near
    met.far = far
    return met
