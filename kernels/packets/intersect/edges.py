"""A packet against the triangles of one block: their edges, then their planes.

A ray with unit direction d passes the edge from Vi to Vj, as seen from its origin, on the side of s = d . (e x V), with
e = Vi - Vj and V either of them (half of that of rigcast.kernels.shapes.triangle). e x V serves all rays.

Rounding, u = eps / 2: one of e, two of V, one each of the products and of the difference of e x V make 5u |e|_1 |V|_1;
d = (a + p u + q v) / length has one each of a, u, v, p and q, one of each product, two of the sums: 5u w, w = 1 + |p| +
|q|, over the length, which is at least w / sqrt(3), and 3u of length and quotient; the dot product has three. So s is
within u (11 + 5 min(w, sqrt(3))) |e|_1 |V|_1 of what it should be. 12 in place of 11 is allowed for.

The distance V0 . n / (d . n) has 5u |V0| of its numerator, and of its denominator 7u t of d as below, 3u t of the
length and 3u t of the dot product; n is off by 4u at most (rigcast.kernels.shapes.patches), which moves it by 4u (|V0|
+ t); its quotient and product have two u t, and adding what it may be off by one more. Together 9u |V0| + 20u t, over
|cos|; 10u |V0| + 24u t are allowed for. As a vector, a + p u + q v is off by u of a, 3u |p| and 3u |q|, as a, u and v
are unit vectors, and by two u of its length: over the length at most (2 + sqrt(19)) u < 7u.

What is too near to call goes to float64, by rigcast.kernels.hits.hit.
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
"""A vector of each of eight triangles."""


@wp.struct
class Edges:
    """What the triangles of a block are to a packet: e x V of each edge, n, V0 . n, |V0|_1, and the rounding of s."""

    side0: vectors
    side1: vectors
    side2: vectors
    normal: vectors
    height: vec8
    size: vec8
    rounding: vec8


@wp.func
def side_rounding(widest: float) -> float:
    """How far s may be off, over |e|_1 |V|_1; widest: the largest w of a packet."""
    return SIDE_ROUNDING + smaller(DIRECTION_ROUNDING * widest, MOST_ROUNDING)


@inlined
def edges_of(block: TriangleBlock, view: View, rounding_of_sides: float) -> Edges:
    """Edges of the triangles of a block as the rays of a packet see them."""
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
    """Bit by bit, the triangles that rays along middle +- spread may hit; widest: the largest w of a packet.

    Rounding, per w |e|_1 |V|_1: e x V has 5u; the middle 6u, of a mean, of p, u and their product, and of two sums; its
    dot product 3u, and the sum with the change one: 15u. What the spread has is less. At least 17u are allowed for.
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
    """From where to where the distance of a ray to a triangle may be, as triage_triangle has it.

    Conditions are wp.where of distances: with `and` and `or` loops are not vectorised, with numbers they are slower.
    """
    # how steep 1 / slope may be where the distance is sure: not at all where the origin is nearly in the plane
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
    """One ray against the triangles of a block, up to a limit."""
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
    """How far inside its nearest edge each ray passes a triangle, and whether (some != 0) any may pass through it."""

    by: lanes
    some: int


@inlined
def pass_edges(x: lanes, y: lanes, z: lanes, side0: wp.vec3, side1: wp.vec3, side2: wp.vec3, rounding: float) -> Inside:
    """The rays of a packet, directions (x, y, z), against the edges of one triangle, as Edges has them."""
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
    """From where to where each ray's distance to a triangle may be."""

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
    """The rays of a packet against one triangle, inside whose edges they pass, as triage_triangle has it."""
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
