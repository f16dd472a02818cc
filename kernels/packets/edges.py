"""A packet against the triangles of one block: their edges, then their planes.

Rounding, u = eps / 2, e = Vi - Vj, m = Vi + Vj: one of e, three of m, one each of the products and of the difference of
c, one of a, and three of the dot product make 10u |e|_1 |m|_1 for each of the three products; p and q have one each,
their products one, the two sums two: s is within 14u |e|_1 (|Vi|_1 + |Vj|_1) (1 + |p| + |q|) of what it should be. 24u
are allowed for. The distance V0 . n / ((a + p u + q v) . n) |a + p u + q v| has 5u |V0| of its numerator and 11u t of
its denominator, over |cos|, and of n, which is off by 4u at most (rigcast.kernels.patches), 4u (|V0| + t); 16u (|V| +
t) / |cos| are allowed for. What is too near to call goes to float64, by rigcast.kernels.hits.
"""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock
from rigcast.kernels.ray import Spans
from rigcast.kernels.shapes.triangle import GRAZING, inside_edges
from rigcast.kernels.shapes.triangle import ROUNDING as HEIGHT_ROUNDING
from rigcast.kernels.traverse import sign_bits
from rigcast.kernels.trees.nodes import WIDTH, vec8, vec8i
from rigcast.kernels.vectors import Interval, interval, larger, norm1, smaller

from .packet import LANES, lanes
from .sought import Sought

SIDE_ROUNDING = wp.constant(12.0 * 2.0**-23)  # 24u
DISTANCE_ROUNDING = wp.constant(8.0 * 2.0**-23)  # 16u


linear = wp.types.matrix(shape=(3, 8), dtype=wp.float32)
"""A linear function of (1, p, q) of each of eight triangles."""


@wp.struct
class Edges:
    """What the triangles of a block are to the rays of a tile, and their rounding."""

    side0: linear
    side1: linear
    side2: linear
    slope: linear
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
    to_basis = wp.matrix_from_rows(sought.view.axis, sought.view.u, sought.view.v)
    scale = SIDE_ROUNDING * sought.widest
    side0 = linear()
    side1 = linear()
    side2 = linear()
    slope = linear()
    rounding = vec8()
    height = vec8()
    reach = vec8()
    for j in range(WIDTH):
        # edge by edge: registers do not suffice for all of them at once
        w0 = wp.vec3(x0[j], y0[j], z0[j])
        w1 = wp.vec3(x1[j], y1[j], z1[j])
        w2 = wp.vec3(x2[j], y2[j], z2[j])
        v0 = (w0 - origin) - rest
        v1 = (w1 - origin) - rest
        size0 = norm1(v0)
        size1 = norm1(v1)
        e0 = w0 - w1
        s0 = to_basis * wp.cross(e0, v0 + v1)
        for k in range(3):
            side0[k, j] = s0[k]
        side = norm1(e0) * (size0 + size1)
        v2 = (w2 - origin) - rest
        size2 = norm1(v2)
        e1 = w1 - w2
        s1 = to_basis * wp.cross(e1, v1 + v2)
        for k in range(3):
            side1[k, j] = s1[k]
        side = larger(side, norm1(e1) * (size1 + size2))
        e2 = w2 - w0
        s2 = to_basis * wp.cross(e2, v2 + v0)
        for k in range(3):
            side2[k, j] = s2[k]
        side = larger(side, norm1(e2) * (size2 + size0))
        n = wp.vec3(normal_x[j], normal_y[j], normal_z[j])
        s = to_basis * n
        for k in range(3):
            slope[k, j] = s[k]
        rounding[j] = scale * side
        height[j] = wp.dot(v0, n)
        reach[j] = larger(size0, larger(size1, size2))
    edges = Edges()
    edges.side0 = side0
    edges.side1 = side1
    edges.side2 = side2
    edges.slope = slope
    edges.rounding = rounding
    edges.height = height
    edges.reach = reach
    return edges


@wp.func
def may_be_hit(edges: Edges, sought: Sought) -> int:
    """Bit by bit, the triangles that a packet may hit: by the sides at its middle, and their change to its corners."""
    side0 = edges.side0
    side1 = edges.side1
    side2 = edges.side2
    rounding = edges.rounding
    p = sought.p
    q = sought.q
    p_half = sought.p_half
    q_half = sought.q_half
    possible = int(0)
    for j in range(WIDTH):
        middle0 = side0[0, j] + p * side0[1, j] + q * side0[2, j]
        middle1 = side1[0, j] + p * side1[1, j] + q * side1[2, j]
        middle2 = side2[0, j] + p * side2[1, j] + q * side2[2, j]
        change0 = p_half * wp.abs(side0[1, j]) + q_half * wp.abs(side0[2, j]) + rounding[j]
        change1 = p_half * wp.abs(side1[1, j]) + q_half * wp.abs(side1[2, j]) + rounding[j]
        change2 = p_half * wp.abs(side2[1, j]) + q_half * wp.abs(side2[2, j]) + rounding[j]
        left = smaller(middle0 + change0, smaller(middle1 + change1, middle2 + change2)) >= 0.0
        right = larger(middle0 - change0, larger(middle1 - change1, middle2 - change2)) <= 0.0
        possible = possible | wp.where(left or right, 1 << j, 0)
    return possible


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
    side0 = edges.side0
    side1 = edges.side1
    side2 = edges.side2
    slopes = edges.slope
    rounding = edges.rounding
    height = edges.height
    size = edges.reach
    near = vec8()
    far = vec8()
    possible = vec8i()
    for j in range(WIDTH):
        s0 = side0[0, j] + p * side0[1, j] + q * side0[2, j]
        s1 = side1[0, j] + p * side1[1, j] + q * side1[2, j]
        s2 = side2[0, j] + p * side2[1, j] + q * side2[2, j]
        slope = slopes[0, j] + p * slopes[1, j] + q * slopes[2, j]
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
