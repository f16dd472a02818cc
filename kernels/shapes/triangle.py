"""A ray P = O + t d (d a unit vector) against one triangle (V0, V1, V2).

            V2              n = (V1 - V0) x (V2 - V0) points to the side from which V0, V1, V2 run counter-clockwise.
           /  \\             Plane:  t = (V0 - O) . n / (d . n)
          / P  \\            Inside: P splits the triangle into (P, V0, V1), (P, V1, V2), (P, V2, V0); it is inside
        V0------V1                  when the normals of all three point the same way as n.

`intersect_triangle_reference` follows these lines step by step and is the readable definition. In float32 it lets rays
through between neighbouring triangles, because P is rounded before it is tested. The cast tests the ray against each
edge without P. With a, b the ends of an edge relative to O, the side on which the ray passes the edge is the sign of

    s(a, b) = d . ((a - b) x (a + b)) = 2 d . (a x b)

`triage_triangle` evaluates s in float32 and answers only where rounding cannot change the answer. It leaves open rays
near edges, nearly edge-on triangles and triangles near the origin; `decide_triangle` decides these few in float64.

Error of s, u = eps / 2, with e = a - b and m = a + b: one rounding of d, two of each vertex (in m; e comes from the
mesh's own vertices), one each of e, m, the products and the difference of the cross product, and three of the dot
product make at most 11u |e|_1 (|a|_1 + |b|_1). A triangle is kept wherever s is within 16u of that product, which also
covers the rounding of the bound itself.

Why meshes cannot leak: no triangle that the ray meets in exact arithmetic is ever dropped, not at its edges and
vertices either, however its neighbours are rounded and whether or not products are fused. What float32 cannot tell goes
to float64, and what float64 cannot tell is a hit. A closed mesh stays closed, and no triangle is larger than it should
be by more than 1e-14 of its distance.

Error of the distance t = w . n / (d . n), w = V0 - O, in float32:

- w: 2u of each component; its dot product with n: 3u;
- d . n: 3u, and u of d itself; the quotient: u;
- n: u, or 4u where it is made as in rigcast.kernels.shapes.patches, which moves t by as much times |P - V0| / |d . n|.

Together 9u |w| + 9u t, over |d . n|. (|d . n| > GRAZING there, so second-order terms are negligible.) The interval
allows for 16u, which also covers the rounding of the bound itself. The distance that is written has at worst n in
float32 and everything else in float64:

    |t - t_ref| <= 3 eps (max_i |Vi - O| + t) / |cos|

In float64 the error is u t when the result is stored, and 1.1e-9 t / |cos| from the tilt (below): smaller, down to
|cos| = 1e-8.

A ray aimed at a vertex, or within a face's plane, has no unique answer. Near edges and nearly edge-on, float64 decides
for a ray tilted by 1e-9 rad in a generic direction, `tilted`: it meets one face first, and that face is the hit. No ray
slips through because of the tilt: all triangles near whose edges it passes are tested against the same tilted ray.
"""

import warp as wp

from rigcast.kernels.trees.nodes import vec8
from rigcast.kernels.vectors import Interval, interval, larger, norm1, quotient, smaller

CULL_NONE = wp.constant(0)
CULL_BACK = wp.constant(1)
CULL_FRONT = wp.constant(-1)

ROUNDING = wp.constant(8.0 * 2.0**-23)  # 16u
DISTANCE_ROUNDING = wp.constant(8.0 * 2.0**-23)  # 16u
GRAZING = wp.constant(0.02)  # |d . n| below which float32 loses the distance
ROUNDING_64 = wp.constant(wp.float64(8.0 * 2.0**-52))
EDGE_ON = wp.constant(wp.float64(1.0e-13))  # |d . n| below which float64 loses the distance
NEARLY_EDGE_ON = wp.constant(wp.float64(1.0e-8))  # |d . n| below which the tilt matters
NEAR_EDGE = wp.constant(wp.float64(100.0))  # distance from an edge, in roundings, within which a ray may be aimed at it
TILT = wp.constant(wp.vec3d(0.62e-9, -0.35e-9, 0.70e-9))


@wp.func
def is_culled(slope: float, cull: int) -> bool:
    """Whether a hit with slope = d . n is dropped: CULL_BACK drops d . n > 0, CULL_FRONT drops d . n < 0."""
    return slope * float(cull) > 0.0


@wp.func
def triangle_normal(v0: wp.vec3, v1: wp.vec3, v2: wp.vec3) -> wp.vec3:
    """The winding normal (V1 - V0) x (V2 - V0), not normalised: its length is twice the area, 0 if degenerate."""
    return wp.cross(v1 - v0, v2 - v0)


@wp.func
def plane_distance(origin: wp.vec3, direction: wp.vec3, v0: wp.vec3, normal: wp.vec3, parallel: float) -> float:
    """Distance t to the plane through v0 with a unit normal, +inf if |d . n| <= parallel or the plane lies behind."""
    slope = wp.dot(direction, normal)
    if wp.abs(slope) <= parallel:
        return wp.inf
    t = wp.dot(v0 - origin, normal) / slope
    if t < 0.0:
        return wp.inf
    return t


@wp.func
def is_inside_triangle(p: wp.vec3, v0: wp.vec3, v1: wp.vec3, v2: wp.vec3, normal: wp.vec3) -> bool:
    """Whether p, a point of the triangle's plane, lies in the triangle, its border included."""
    return (
        wp.dot(triangle_normal(p, v0, v1), normal) >= 0.0
        and wp.dot(triangle_normal(p, v1, v2), normal) >= 0.0
        and wp.dot(triangle_normal(p, v2, v0), normal) >= 0.0
    )


@wp.func
def intersect_triangle_reference(
    origin: wp.vec3, direction: wp.vec3, v0: wp.vec3, v1: wp.vec3, v2: wp.vec3, cull: int, parallel: float
) -> float:
    """Distance to the triangle along the unit direction, +inf on a miss: the readable definition.

    Args:
        cull: CULL_NONE, CULL_BACK (drop d . n > 0) or CULL_FRONT (drop d . n < 0).
        parallel: |d . n| up to which a ray counts as parallel to the plane and misses; 0 keeps every grazing hit.
    """
    area_normal = triangle_normal(v0, v1, v2)
    area = wp.length(area_normal)
    if area == 0.0:
        return wp.inf
    normal = area_normal / area
    if is_culled(wp.dot(direction, normal), cull):
        return wp.inf
    t = plane_distance(origin, direction, v0, normal, parallel)
    if t == wp.inf:
        return wp.inf
    if not is_inside_triangle(origin + t * direction, v0, v1, v2, normal):
        return wp.inf
    return t


@wp.func
def edge_side(direction: wp.vec3, e: wp.vec3, a: wp.vec3, b: wp.vec3) -> float:
    """The side s(a, b) of an edge, with e = a - b."""
    return wp.dot(direction, wp.cross(e, a + b))


@wp.func
def edge_rounding(e: wp.vec3, a: wp.vec3, b: wp.vec3) -> float:
    """Upper bound on the error of s(a, b)."""
    return ROUNDING * norm1(e) * (norm1(a) + norm1(b))


@wp.func
def inside_edges(s0: float, s1: float, s2: float) -> float:
    """How far inside its nearest edge a ray passes a triangle, from its three sides s; negative outside."""
    return larger(smaller(s0, smaller(s1, s2)), -larger(s0, larger(s1, s2)))


@wp.func
def triage_inside(direction: wp.vec3, v0: wp.vec3, normal: wp.vec3, cull: int) -> Interval:
    """triage_triangle for a triangle whose edges the ray surely passes on the same side.

    Args:
        v0: any of its vertices relative to the ray's origin.
        normal: the unit winding normal.
    """
    slope = wp.dot(direction, normal)
    height = wp.dot(v0, normal)
    t = quotient(height, slope)
    error = quotient(DISTANCE_ROUNDING * (norm1(v0) + wp.abs(t)), wp.abs(slope))
    is_sure = wp.abs(slope) > GRAZING and wp.abs(height) > ROUNDING * norm1(v0)
    is_hit = not (is_sure and (t < 0.0 or is_culled(slope, cull)))
    near = wp.where(is_hit, wp.where(is_sure, t - error, 0.0), wp.inf)
    far = wp.where(is_hit and is_sure, t + error, wp.inf)
    return interval(near, far)


@wp.func
def triage_triangle(
    direction: wp.vec3,
    e0: wp.vec3,
    e1: wp.vec3,
    e2: wp.vec3,
    v0: wp.vec3,
    v1: wp.vec3,
    v2: wp.vec3,
    normal: wp.vec3,
    cull: int,
) -> Interval:
    """Interval of the distance to the triangle along the unit direction.

    (+inf, +inf) on a sure miss, (0, +inf) where rounding could turn a miss into a hit.

    Args:
        e0, e1, e2: V0 - V1, V1 - V2, V2 - V0.
        v0, v1, v2: the vertices relative to the ray's origin, V - O. A triangle of NaN is never hit.
        normal: the unit winding normal.
    """
    s0 = edge_side(direction, e0, v0, v1)
    s1 = edge_side(direction, e1, v1, v2)
    s2 = edge_side(direction, e2, v2, v0)
    r0 = edge_rounding(e0, v0, v1)
    r1 = edge_rounding(e1, v1, v2)
    r2 = edge_rounding(e2, v2, v0)
    # seen along the winding normal (d . n > 0), s > 0 on all edges inside; seen against it, s < 0
    is_left = smaller(s0 + r0, smaller(s1 + r1, s2 + r2)) >= 0.0
    is_right = larger(s0 - r0, larger(s1 - r1, s2 - r2)) <= 0.0
    if not (is_left or is_right):
        return interval(wp.inf, wp.inf)
    if smaller(wp.abs(s0) - r0, smaller(wp.abs(s1) - r1, wp.abs(s2) - r2)) <= 0.0:
        return interval(0.0, wp.inf)
    return triage_inside(direction, v0, normal, cull)


@wp.struct
class Spans:
    """Intervals of a ray's distances to the triangles of a block; possible: bit mask of those that may be hit."""

    near: vec8
    far: vec8
    possible: int


@wp.func
def norm1_64(a: wp.vec3d) -> wp.float64:
    return wp.abs(a[0]) + wp.abs(a[1]) + wp.abs(a[2])


@wp.func
def edge_side_64(direction: wp.vec3d, a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    return wp.dot(direction, wp.cross(a - b, a + b))


@wp.func
def edge_rounding_64(a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    """Upper bound on the error of edge_side_64."""
    return ROUNDING_64 * norm1_64(a - b) * (norm1_64(a) + norm1_64(b))


@wp.func
def least_room(direction: wp.vec3d, v0: wp.vec3d, v1: wp.vec3d, v2: wp.vec3d, normal: wp.vec3d) -> wp.float64:
    """How far inside its nearest edge the ray passes, in multiples of that edge's rounding: >= -1 may be inside."""
    side = wp.where(wp.dot(direction, normal) > wp.float64(0.0), wp.float64(1.0), wp.float64(-1.0))
    room0 = side * edge_side_64(direction, v0, v1) / edge_rounding_64(v0, v1)
    room1 = side * edge_side_64(direction, v1, v2) / edge_rounding_64(v1, v2)
    room2 = side * edge_side_64(direction, v2, v0) / edge_rounding_64(v2, v0)
    return wp.min(room0, wp.min(room1, room2))


@wp.func
def tilted(direction: wp.vec3d) -> wp.vec3d:
    """The direction for decisions in float64, tilted so that it runs along no edge or face as the given one may."""
    return direction + TILT


@wp.func
def precedes(a: wp.vec3d, b: wp.vec3d) -> bool:
    """Whether a precedes b in lexicographic order of x, y, z."""
    return a[0] < b[0] or (a[0] == b[0] and (a[1] < b[1] or (a[1] == b[1] and a[2] < b[2])))


@wp.func
def former(a: wp.vec3d, b: wp.vec3d) -> wp.vec3d:
    return wp.where(precedes(b, a), b, a)


@wp.func
def latter(a: wp.vec3d, b: wp.vec3d) -> wp.vec3d:
    return wp.where(precedes(b, a), a, b)


@wp.func
def distance_by_order(direction: wp.vec3d, v0: wp.vec3d, v1: wp.vec3d, v2: wp.vec3d) -> wp.float64:
    """Distance to the triangle's plane, bit for bit the same for any order of its vertices."""
    a = former(former(v0, v1), v2)
    b = former(latter(v0, v1), latter(former(v0, v1), v2))
    c = latter(latter(v0, v1), v2)
    normal = wp.cross(b - a, c - a)
    return wp.dot(a, normal) / wp.dot(direction, normal)


@wp.func
def decide_triangle(direction: wp.vec3d, v0: wp.vec3d, v1: wp.vec3d, v2: wp.vec3d, cull: int) -> wp.float64:
    """Distance to the triangle along the unit direction, +inf on a miss, decided in float64.

    Near an edge, or nearly in the triangle's plane, the tilted ray is tested in place of the given one.
    """
    normal = wp.cross(v1 - v0, v2 - v0)
    size = wp.length(normal)
    slope = wp.dot(direction, normal)
    ray = direction
    if wp.abs(slope) <= NEARLY_EDGE_ON * size or least_room(direction, v0, v1, v2, normal) < NEAR_EDGE:
        ray = tilted(direction)
        slope = wp.dot(ray, normal)
        if wp.abs(slope) <= EDGE_ON * size or least_room(ray, v0, v1, v2, normal) < wp.float64(-1.0):
            return wp.float64(wp.inf)
    t = distance_by_order(ray, v0, v1, v2)
    if t < wp.float64(0.0) or is_culled(float(slope), cull):
        return wp.float64(wp.inf)
    return t
