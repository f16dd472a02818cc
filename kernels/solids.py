"""A ray against MuJoCo's closed-form geoms, in the geom's own frame and with MuJoCo's rules.

Spheres, capsules, ellipsoids, cylinders and boxes are convex solids. A ray o + t d meets one in an interval
[t_in, t_out], or not at all (t_in > t_out). It hits where it enters, or from inside where it leaves; a
touch counts, and so does an origin on the surface (t = 0). At t_in the ray opposes the outward normal, at t_out it
follows it, which is all that culling needs to know.

A plane is not a solid: it has one side and is hit only from above.

Sizes are MuJoCo's `geom_size`: sphere (radius), capsule and cylinder (radius, half length along z), ellipsoid (the
three radii), box (the three half sizes), plane (half sizes along x and y, 0 where infinite).

How wrong t may be, to first order in u = eps / 2, for o and d that were rounded to float32 and cos = d . normal:

    plane      1.5 eps t: o, d and the quotient have u each
    box        eps (|o_k| / (2 |cos|) + 1.5 t), k the axis of the face: as above, and one u for half - o
    sphere     7 eps (|o| + t) / |cos|
    ellipsoid  eps (7.5 |o'| + 12 t') / |d' . p'|, all divided by the radii: o' = o / r, d' = d / r, p' = p / r, and
               t' = t |d'|; at most r_max / r_min times eps (7.5 |o| + 12 t) / |cos|
    cylinder   side: eps (7 |o_xy| + 10 t) / |cos|; caps: as a box
    capsule    10 eps (|o| + half + t) / |cos|

The sphere: with b = o . d, l = o - b d, h = sqrt(r^2 - l^2), all relative to its size, b has 3u |o|, |l| has u |b| and
3.5u |l|, and h, as h dh = l dl, 3.64u |o| / |cos| and 2.5u h; c = (|o| - r)(|o| + r) has 5u |o| max(|o|, r) and 3u c,
of which c / q makes 5u |o| / |cos| and 3u t, because max(|o|, r) |cos| <= |q|. The rounding of o and d adds
u (|o| + t) / |cos|, that d is not quite of length 1 another u t. Together (12.7 |o| + 9.5 t) u / |cos|; the rest up to
7 eps = 14u is for second orders, up to cos^2 = 32 eps |o| / r. Nearer to a touch the ray may hit or miss.
The cylinder adds 3u for the direction in its plane and 4u for the speed there, the capsule u (|o| + half) for
o - end, the ellipsoid u of each division: 2u for o', 3u for the direction's angle, 5.5u for its length, twice.
Within such an error of a crease (the edge of a box, the rim of a cylinder) the other face may be the one that is hit.
"""

import warp as wp

from .triangle import CULL_BACK, CULL_FRONT
from .vectors import Interval, interval, larger, smaller

PLANE = wp.constant(0)
SPHERE = wp.constant(1)
CAPSULE = wp.constant(2)
ELLIPSOID = wp.constant(3)
CYLINDER = wp.constant(4)
BOX = wp.constant(5)
TRIANGLES = wp.constant(6)
SHEET = wp.constant(7)  # triangles with two outer sides: the normal is that of the side that the ray comes from

PLACE_ROUNDING = wp.constant(2.0**-22)
MINIMUM = wp.constant(1.0e-15)  # MuJoCo's mjMINVAL: a ray less steep than this runs along a plane


@wp.func
def has_triangles(kind: int) -> bool:
    """Whether a shape of this kind is a tree of triangles, not a closed form."""
    return kind >= TRIANGLES


@wp.func
def interval_if(condition: bool, t_in: float, t_out: float) -> Interval:
    """The interval, or an empty one."""
    return interval(wp.where(condition, t_in, wp.inf), wp.where(condition, t_out, -wp.inf))


@wp.func
def first_hit(crossed: Interval, cull: int) -> float:
    """Where a ray first meets a solid that it crosses in the interval: entry, else exit, else +inf."""
    t_in = crossed[0]
    t_out = crossed[1]
    exit = wp.where(t_out >= 0.0, wp.where(cull == CULL_BACK, wp.inf, t_out), wp.inf)
    entry = wp.where(t_in >= 0.0, wp.where(cull == CULL_FRONT, exit, t_in), exit)
    return wp.where(t_in > t_out, wp.inf, entry)


@wp.func
def overlap(a: Interval, b: Interval) -> Interval:
    t_in = larger(a[0], b[0])
    t_out = smaller(a[1], b[1])
    return interval_if(t_in <= t_out, t_in, t_out)


@wp.func
def hull(a: Interval, b: Interval) -> Interval:
    """The least interval with a and b in it, where one that is empty counts for nothing."""
    return interval(smaller(a[0], b[0]), larger(a[1], b[1]))


@wp.func
def sphere_interval(o: wp.vec3, d: wp.vec3, radius: float) -> Interval:
    """|o + t d| = r for a unit d, in the form that keeps its digits for small and far spheres.

    The discriminant is r^2 - |l|^2 with l = o - (o . d) d, the ray's nearest point to the centre, instead of the
    difference of two large squares; of the two roots the larger in size is computed, q, and the other is
    (|o|^2 - r^2) / q. (Haines et al., "Precision improvements for ray/sphere intersection", Ray Tracing Gems, 2019.)
    """
    b = wp.dot(o, d)
    nearest = wp.length(o - b * d)
    discriminant = (radius - nearest) * (radius + nearest)
    half = wp.sqrt(larger(discriminant, 0.0))
    distance = wp.length(o)
    c = (distance - radius) * (distance + radius)
    q = wp.where(b <= 0.0, half - b, -half - b)
    other = wp.where(q == 0.0, 0.0, c / q)
    return interval_if(discriminant >= 0.0, wp.where(b <= 0.0, other, q), wp.where(b <= 0.0, q, other))


@wp.func
def ellipsoid_interval(o: wp.vec3, d: wp.vec3, radii: wp.vec3) -> Interval:
    """The unit sphere, after dividing each axis by its radius; distances shrink by |d / radii|."""
    scaled = wp.cw_div(d, radii)
    scale = wp.length(scaled)
    unscaled = sphere_interval(wp.cw_div(o, radii), scaled / scale, 1.0)
    return interval(unscaled[0] / scale, unscaled[1] / scale)


@wp.func
def slab_interval(o: float, d: float, half: float) -> Interval:
    """Where |o + t d| <= half."""
    a = (-half - o) / d
    b = (half - o) / d
    along = interval_if(wp.abs(o) <= half, -wp.inf, wp.inf)
    return interval(wp.where(d == 0.0, along[0], smaller(a, b)), wp.where(d == 0.0, along[1], larger(a, b)))


@wp.func
def cylinder_interval(o: wp.vec3, d: wp.vec3, radius: float, half: float) -> Interval:
    """The circle x^2 + y^2 = r^2, solved as a sphere in the plane, cut by the slab |z| <= half."""
    flat = wp.vec3(d[0], d[1], 0.0)
    speed = wp.length(flat)
    across = wp.vec3(o[0], o[1], 0.0)
    along = interval_if(wp.length(across) <= radius, -wp.inf, wp.inf)
    round = sphere_interval(across, flat / speed, radius)
    side_in = wp.where(speed == 0.0, along[0], round[0] / speed)
    side_out = wp.where(speed == 0.0, along[1], round[1] / speed)
    return overlap(interval(side_in, side_out), slab_interval(o[2], d[2], half))


@wp.func
def capsule_interval(o: wp.vec3, d: wp.vec3, radius: float, half: float) -> Interval:
    """The cylinder and its two end spheres overlap and their union is convex: the hull of the three intervals."""
    end = wp.vec3(0.0, 0.0, half)
    ends = hull(sphere_interval(o - end, d, radius), sphere_interval(o + end, d, radius))
    return hull(ends, cylinder_interval(o, d, radius, half))


@wp.func
def box_interval(o: wp.vec3, d: wp.vec3, half: wp.vec3) -> Interval:
    """The common part of three slabs."""
    xy = overlap(slab_interval(o[0], d[0], half[0]), slab_interval(o[1], d[1], half[1]))
    return overlap(xy, slab_interval(o[2], d[2], half[2]))


@wp.func
def intersect_plane(o: wp.vec3, d: wp.vec3, size: wp.vec3, cull: int) -> float:
    """Distance to the plane z = 0 from above, +inf from below, off its rectangle, or where culled."""
    t = -o[2] / d[2]
    x = wp.where(size[0] <= 0.0, 0.0, wp.abs(o[0] + t * d[0]) - size[0])
    y = wp.where(size[1] <= 0.0, 0.0, wp.abs(o[1] + t * d[1]) - size[1])
    is_above = wp.where(d[2] < -MINIMUM, wp.where(o[2] >= 0.0, wp.where(cull == CULL_FRONT, 0, 1), 0), 0)
    return wp.where(is_above & wp.where(x <= 0.0, 1, 0) & wp.where(y <= 0.0, 1, 0) == 1, t, wp.inf)


@wp.func
def intersect_sphere(o: wp.vec3, d: wp.vec3, size: wp.vec3, cull: int) -> float:
    return first_hit(sphere_interval(o, d, size[0]), cull)


@wp.func
def intersect_capsule(o: wp.vec3, d: wp.vec3, size: wp.vec3, cull: int) -> float:
    return first_hit(capsule_interval(o, d, size[0], size[1]), cull)


@wp.func
def intersect_ellipsoid(o: wp.vec3, d: wp.vec3, size: wp.vec3, cull: int) -> float:
    return first_hit(ellipsoid_interval(o, d, size), cull)


@wp.func
def intersect_cylinder(o: wp.vec3, d: wp.vec3, size: wp.vec3, cull: int) -> float:
    return first_hit(cylinder_interval(o, d, size[0], size[1]), cull)


@wp.func
def intersect_box(o: wp.vec3, d: wp.vec3, size: wp.vec3, cull: int) -> float:
    return first_hit(box_interval(o, d, size), cull)


@wp.func
def intersect_closed_form(kind: int, size: wp.vec3, o: wp.vec3, d: wp.vec3, cull: int) -> float:
    """Distance along the unit direction d to the surface of one closed-form geom, +inf on a miss."""
    if kind == PLANE:
        return intersect_plane(o, d, size, cull)
    if kind == SPHERE:
        return intersect_sphere(o, d, size, cull)
    if kind == CAPSULE:
        return intersect_capsule(o, d, size, cull)
    if kind == ELLIPSOID:
        return intersect_ellipsoid(o, d, size, cull)
    if kind == CYLINDER:
        return intersect_cylinder(o, d, size, cull)
    if kind == BOX:
        return intersect_box(o, d, size, cull)
    return wp.inf


@wp.func
def normalized(a: wp.vec3) -> wp.vec3:
    """Of length 1, or 0."""
    length = wp.length(a)
    return a * wp.where(length > 0.0, 1.0 / length, 0.0)


@wp.func
def plane_normal(p: wp.vec3, d: wp.vec3, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    return wp.vec3(0.0, 0.0, 1.0)


@wp.func
def sphere_normal(p: wp.vec3, d: wp.vec3, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    return normalized(p)


@wp.func
def capsule_normal(p: wp.vec3, d: wp.vec3, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    return normalized(wp.vec3(p[0], p[1], p[2] - larger(-size[1], smaller(p[2], size[1]))))


@wp.func
def ellipsoid_normal(p: wp.vec3, d: wp.vec3, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    """The gradient of (x / a)^2 + (y / b)^2 + (z / c)^2, scaled against overflow."""
    return normalized(wp.cw_div(wp.cw_div(p, size), size / wp.max(size)))


@wp.func
def time_off(gap: float, speed: float, size: float) -> float:
    """How far along a ray a face is whose plane lies a gap away, rounding included: never 0 within the plane."""
    return (wp.abs(gap) + PLACE_ROUNDING * size) / wp.abs(speed)


@wp.func
def cylinder_normal(p: wp.vec3, d: wp.vec3, size: wp.vec3) -> wp.vec3:
    """Of the side and the caps, the surface that the ray crosses nearest to p."""
    out = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    per_out = wp.where(out > 0.0, 1.0 / out, 0.0)
    side = time_off(out - size[0], (p[0] * d[0] + p[1] * d[1]) * per_out, out + size[0])
    cap = time_off(wp.abs(p[2]) - size[1], d[2], wp.abs(p[2]) + size[1])
    on_side = wp.where(cap < side, 0.0, per_out)
    return wp.vec3(p[0] * on_side, p[1] * on_side, wp.where(cap < side, wp.sign(p[2]), 0.0))


@wp.func
def box_normal(p: wp.vec3, d: wp.vec3, size: wp.vec3) -> wp.vec3:
    """Of the six faces, the one that the ray crosses nearest to p."""
    x = time_off(wp.abs(p[0]) - size[0], d[0], size[0])
    y = time_off(wp.abs(p[1]) - size[1], d[1], size[1])
    z = time_off(wp.abs(p[2]) - size[2], d[2], size[2])
    on_x = wp.where(x <= y, wp.where(x <= z, 1.0, 0.0), 0.0)
    on_y = wp.where(y <= z, 1.0 - on_x, 0.0)
    return wp.vec3(on_x * wp.sign(p[0]), on_y * wp.sign(p[1]), (1.0 - on_x - on_y) * wp.sign(p[2]))


@wp.func
def closed_form_normal(kind: int, size: wp.vec3, p: wp.vec3, d: wp.vec3) -> wp.vec3:
    """Unit outward normal of a closed-form geom where a ray along d hits it at the point p."""
    if kind == SPHERE:
        return sphere_normal(p, d, size)
    if kind == CAPSULE:
        return capsule_normal(p, d, size)
    if kind == ELLIPSOID:
        return ellipsoid_normal(p, d, size)
    if kind == CYLINDER:
        return cylinder_normal(p, d, size)
    if kind == BOX:
        return box_normal(p, d, size)
    return plane_normal(p, d, size)
