"""A packet against the triangles of one block: their edges, then their planes.

Rounding, u = eps / 2, e = Vi - Vj, m = Vi + Vj: one of e, three of m, one each of the products and of the difference of
c, one of a, and three of the dot product make 10u |e|_1 |m|_1 for each of the three products; p and q have one each,
their products one, the two sums two: s is within 14u |e|_1 (|Vi|_1 + |Vj|_1) (1 + |p| + |q|) of what it should be. 24u
are allowed for. The distance V0 . n / ((a + p u + q v) . n) |a + p u + q v| has 6u |V0| of its numerator and 12u t of
its denominator, over |cos|; 16u (|V| + t) / |cos| are allowed for. What is too near to call goes to float64, by
rigcast.kernels.hits.
"""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock
from rigcast.kernels.ray import Spans
from rigcast.kernels.shapes.triangle import GRAZING
from rigcast.kernels.shapes.triangle import ROUNDING as HEIGHT_ROUNDING
from rigcast.kernels.traverse import sign_bits
from rigcast.kernels.trees.nodes import WIDTH, vec8, vec8i
from rigcast.kernels.vectors import Interval, interval, larger, norm1, smaller

from .packet import LANES, lanes
from .sought import Sought

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


@wp.func
def edges_of(block: TriangleBlock, sought: Sought) -> Edges:
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
    origin = sought.view.origin
    rest = sought.view.origin_rest
    a = sought.view.axis
    u = sought.view.u
    v = sought.view.v
    scale = SIDE_ROUNDING * sought.widest
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
    for j in range(WIDTH):
        w0 = wp.vec3(x0[j], y0[j], z0[j])
        w1 = wp.vec3(x1[j], y1[j], z1[j])
        w2 = wp.vec3(x2[j], y2[j], z2[j])
        v0 = (w0 - origin) - rest
        v1 = (w1 - origin) - rest
        size0 = norm1(v0)
        size1 = norm1(v1)
        e0 = w0 - w1
        c0 = wp.cross(e0, v0 + v1)
        s0a[j] = wp.dot(c0, a)
        s0u[j] = wp.dot(c0, u)
        s0v[j] = wp.dot(c0, v)
        side0 = norm1(e0) * (size0 + size1)
        v2 = (w2 - origin) - rest
        size2 = norm1(v2)
        e1 = w1 - w2
        c1 = wp.cross(e1, v1 + v2)
        s1a[j] = wp.dot(c1, a)
        s1u[j] = wp.dot(c1, u)
        s1v[j] = wp.dot(c1, v)
        side1 = norm1(e1) * (size1 + size2)
        e2 = w2 - w0
        c2 = wp.cross(e2, v2 + v0)
        s2a[j] = wp.dot(c2, a)
        s2u[j] = wp.dot(c2, u)
        s2v[j] = wp.dot(c2, v)
        side2 = norm1(e2) * (size2 + size0)
        side = larger(side0, larger(side1, side2))
        n = wp.vec3(normal_x[j], normal_y[j], normal_z[j])
        na[j] = wp.dot(n, a)
        nu[j] = wp.dot(n, u)
        nv[j] = wp.dot(n, v)
        rounding[j] = scale * side
        height[j] = wp.dot(v0, n)
        reach[j] = larger(size0, larger(size1, size2))
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
    return edges


@wp.func
def may_be_hit(edges: Edges, sought: Sought) -> int:
    """Bit by bit, the triangles that a packet may hit: by the sides at its middle, and their change to its corners."""
    side0_a = edges.side0_a
    side0_u = edges.side0_u
    side0_v = edges.side0_v
    side1_a = edges.side1_a
    side1_u = edges.side1_u
    side1_v = edges.side1_v
    side2_a = edges.side2_a
    side2_u = edges.side2_u
    side2_v = edges.side2_v
    rounding = edges.rounding
    p = sought.p
    q = sought.q
    p_half = sought.p_half
    q_half = sought.q_half
    possible = int(0)
    for j in range(WIDTH):
        middle0 = side0_a[j] + p * side0_u[j] + q * side0_v[j]
        middle1 = side1_a[j] + p * side1_u[j] + q * side1_v[j]
        middle2 = side2_a[j] + p * side2_u[j] + q * side2_v[j]
        change0 = p_half * wp.abs(side0_u[j]) + q_half * wp.abs(side0_v[j]) + rounding[j]
        change1 = p_half * wp.abs(side1_u[j]) + q_half * wp.abs(side1_v[j]) + rounding[j]
        change2 = p_half * wp.abs(side2_u[j]) + q_half * wp.abs(side2_v[j]) + rounding[j]
        left = smaller(middle0 + change0, smaller(middle1 + change1, middle2 + change2)) >= 0.0
        right = larger(middle0 - change0, larger(middle1 - change1, middle2 - change2)) <= 0.0
        possible = possible | wp.where(left or right, 1 << j, 0)
    return possible


@wp.func
def inside_edges(s0: float, s1: float, s2: float) -> float:
    """How far inside its nearest edge a ray passes a triangle, by its three sides."""
    return larger(smaller(s0, smaller(s1, s2)), -larger(s0, larger(s1, s2)))


@wp.func
def span_in_plane(
    inside: float, slope: float, length: float, rounding: float, height: float, size: float, cull: int
) -> Interval:
    """From where to where the distance of a ray to a triangle may be, as triage_triangle has it.

    Conditions are wp.where of distances: with `and` and `or` loops are not vectorised, with numbers they are slower.
    """
    # how steep 1 / slope may be where the distance is sure: not at all where the origin is nearly in the plane
    steepest = wp.where(wp.abs(height) > HEIGHT_ROUNDING * size, 1.0 / GRAZING, 0.0)
    per_slope = length / slope
    t = height * per_slope
    error = DISTANCE_ROUNDING * (size + wp.abs(t)) * wp.abs(per_slope)
    is_dropped = larger(-t, slope * float(cull)) > 0.0
    sure_near = wp.where(is_dropped, wp.inf, t - error)
    sure_far = wp.where(is_dropped, wp.inf, t + error)
    is_steep = wp.abs(per_slope) < steepest
    hit_near = wp.where(inside > rounding, wp.where(is_steep, sure_near, 0.0), 0.0)
    near = wp.where(inside >= -rounding, hit_near, wp.inf)
    far = wp.where(inside > rounding, wp.where(is_steep, sure_far, wp.inf), wp.inf)
    return interval(near, far)


@wp.func
def meet_triangles(edges: Edges, p: float, q: float, length: float, cull: int, limit: float) -> Spans:
    """One ray against the triangles of a block, up to a limit."""
    side0_a = edges.side0_a
    side0_u = edges.side0_u
    side0_v = edges.side0_v
    side1_a = edges.side1_a
    side1_u = edges.side1_u
    side1_v = edges.side1_v
    side2_a = edges.side2_a
    side2_u = edges.side2_u
    side2_v = edges.side2_v
    slope_a = edges.slope_a
    slope_u = edges.slope_u
    slope_v = edges.slope_v
    rounding = edges.rounding
    height = edges.height
    size = edges.reach
    near = vec8()
    far = vec8()
    possible = vec8i()
    for j in range(WIDTH):
        s0 = side0_a[j] + p * side0_u[j] + q * side0_v[j]
        s1 = side1_a[j] + p * side1_u[j] + q * side1_v[j]
        s2 = side2_a[j] + p * side2_u[j] + q * side2_v[j]
        slope = slope_a[j] + p * slope_u[j] + q * slope_v[j]
        span = span_in_plane(inside_edges(s0, s1, s2), slope, length, rounding[j], height[j], size[j], cull)
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


@wp.func
def pass_edges(p: lanes, q: lanes, side0: wp.vec3, side1: wp.vec3, side2: wp.vec3, rounding: float) -> Inside:
    """The rays of a packet against the edges of one triangle; side0 and so on are those of Edges."""
    by = lanes()
    some = int(0)
    for i in range(LANES):
        s0 = side0[0] + p[i] * side0[1] + q[i] * side0[2]
        s1 = side1[0] + p[i] * side1[1] + q[i] * side1[2]
        s2 = side2[0] + p[i] * side2[1] + q[i] * side2[2]
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


@wp.func
def meet_plane(
    p: lanes,
    q: lanes,
    length: lanes,
    inside: lanes,
    slopes: wp.vec3,
    rounding: float,
    height: float,
    size: float,
    cull: int,
) -> Met:
    """The rays of a packet against one triangle, inside whose edges they pass, as triage_triangle has it."""
    near = lanes()
    far = lanes()
    for i in range(LANES):
        slope = slopes[0] + p[i] * slopes[1] + q[i] * slopes[2]
        span = span_in_plane(inside[i], slope, length[i], rounding, height, size, cull)
        near[i] = span[0]
        far[i] = span[1]
    met = Met()
    met.near = near
    met.far = far
    return met
