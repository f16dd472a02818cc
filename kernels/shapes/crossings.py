"""Crossings of a ray o + t d with a convex solid: where it enters and leaves, in float32 or in float64.

A crossing is [earliest entry, latest entry, earliest exit, latest exit]: bounds on t_in and t_out under rounding by
eps, that of float32, or 0. A fifth, unused number keeps it out of vector registers, as in vectors.Interval.

Error of t in float32, to first order in u = eps / 2, for o and d that were rounded to float32 and cos = d . normal:

    plane      1.5 eps t: o, d and the quotient have u each
    slab       eps (|o_k| / (2 |d_k|) + 2 t), k its axis: as above, and one u each for half - o and 1 / d
    sphere     7 eps (|o| + t) / |cos|
    ellipsoid  eps (7.5 |o'| + 12 t') / |d' . p'|, all divided by the radii: o' = o / r, d' = d / r, p' = p / r, and
               t' = t |d'|
    cylinder   side: eps (7 |o_xy| + 10.5 t) / |cos|; caps: as a slab
    capsule    10 eps (|o| + half + t) / |cos|

Derivation for the sphere, with b = o . d, l = o - b d, h = sqrt(r^2 - l^2), all relative to its size:

- b: 3u |o|; |l|: u |b| and 3.5u |l|; h, as h dh = l dl: 3.64u |o| / |cos| and 2.5u h;
- c = (|o| - r)(|o| + r): 5u |o| max(|o|, r) and 3u c, which gives c / q an error of 5u |o| / |cos| and 3u t, because
  max(|o|, r) |cos| <= |q|;
- rounding of o and d: u (|o| + t) / |cos|; the length of d being off 1: u t.

Together (12.7 |o| + 9.5 t) u / |cos|. The rest up to 7 eps = 14u covers second-order terms. The cylinder adds 3u for
the direction in its plane and 5u for the speed there. The capsule adds u (|o| + half) for o - end. The ellipsoid adds u
for each division: 2u for o', 3u for the direction's angle, 5.5u for its length, twice. ROUND is larger than any of
these.

The error of |l| itself is at most u (|o| + half) + 4u |b| + 4.5u |l|, less than 10u (|o| + half). A ray that passes a
round surface within TOUCH, a multiple of that error, may touch it or not. Elsewhere cos^2 > 2 TOUCH (|o| + half) / r,
and second-order terms are small.
"""

from typing import Any

import warp as wp

ROUND = wp.constant(13.0)  # in eps (|o| + t) / |cos|
TOUCH = wp.constant(16.0)  # in eps (|o| + half)
MINIMUM = wp.constant(1.0e-15)  # MuJoCo's mjMINVAL: a ray less steep than this runs along a plane


@wp.func
def most(a: Any, b: Any) -> Any:
    """The larger number, as vectors.larger, in float32 or float64."""
    return wp.where(a > b, a, b)


@wp.func
def least(a: Any, b: Any) -> Any:
    return wp.where(a < b, a, b)


@wp.func
def crossing(in_low: Any, in_high: Any, out_low: Any, out_high: Any) -> Any:
    return wp.vector(in_low, in_high, out_low, out_high, out_high)


@wp.func
def crossing_if(condition: bool, a: Any, b: Any) -> Any:
    """Crossing a if the condition holds, else b."""
    return crossing(
        wp.where(condition, a[0], b[0]),
        wp.where(condition, a[1], b[1]),
        wp.where(condition, a[2], b[2]),
        wp.where(condition, a[3], b[3]),
    )


@wp.func
def overlap(a: Any, b: Any) -> Any:
    return crossing(most(a[0], b[0]), most(a[1], b[1]), least(a[2], b[2]), least(a[3], b[3]))


@wp.func
def hull(a: Any, b: Any) -> Any:
    """The crossing from the first entry to the last exit. Empty crossings must be surely empty; see `settled`."""
    return crossing(least(a[0], b[0]), least(a[1], b[1]), most(a[2], b[2]), most(a[3], b[3]))


@wp.func
def settled(a: Any) -> Any:
    """A crossing for `hull`: a surely empty one becomes neutral, one that may be empty becomes unbounded."""
    infinity = type(a[0])(wp.inf)
    is_empty = a[0] > a[3]
    is_open = a[1] > a[2]
    sure = crossing_if(is_open, crossing(-infinity, infinity, -infinity, infinity), a)
    return crossing_if(is_empty, crossing(infinity, infinity, -infinity, -infinity), sure)


@wp.func
def alongside(gap: Any, rounding: Any) -> Any:
    """Crossing of a ray that runs along a surface at a distance `gap`, negative inside: always within, or never."""
    infinity = type(gap)(wp.inf)
    zero = type(gap)(0.0)
    low = wp.where(gap - rounding <= zero, -infinity, infinity)
    high = wp.where(gap + rounding <= zero, -infinity, infinity)
    return crossing(low, high, -high, -low)


@wp.func
def slab_crossing(o: Any, d: Any, half: Any, eps: Any) -> Any:
    """Crossing of the slab |o + t d| <= half along one axis."""
    is_along = wp.abs(d) <= type(o)(MINIMUM)
    inverse = type(o)(1.0) / wp.where(is_along, type(o)(1.0), d)
    a = (-half - o) * inverse
    b = (half - o) * inverse
    t_in = least(a, b)
    t_out = most(a, b)
    rounding = eps * wp.abs(o * inverse)
    round_in = rounding + type(o)(3.0) * eps * wp.abs(t_in)
    round_out = rounding + type(o)(3.0) * eps * wp.abs(t_out)
    through = crossing(t_in - round_in, t_in + round_in, t_out - round_out, t_out + round_out)
    return crossing_if(is_along, alongside(wp.abs(o) - half, eps * wp.abs(o)), through)


@wp.func
def sphere_crossing(o: Any, d: Any, radius: Any, half: Any, eps: Any) -> Any:
    """Crossing of the sphere: |o + t d| = r for a unit d, in a form that stays precise for small and far spheres.

    The discriminant is r^2 - |l|^2, where l = o - (o . d) d is the ray's nearest point to the centre, in place of a
    difference of two large squares. The root q of larger magnitude is computed, the other is (|o|^2 - r^2) / q.
    (Haines et al., "Precision improvements for ray/sphere intersection", Ray Tracing Gems, 2019.)
    """
    zero = type(radius)(0.0)
    infinity = type(radius)(wp.inf)
    b = wp.dot(o, d)
    nearest = wp.length(o - b * d)
    chord = wp.sqrt(most((radius - nearest) * (radius + nearest), zero))
    distance = wp.length(o)
    c = (distance - radius) * (distance + radius)
    q = wp.where(b <= zero, chord - b, -chord - b)
    other = wp.where(q == zero, zero, c / q)
    gap = nearest - radius
    may_touch = wp.abs(gap) < type(radius)(TOUCH) * eps * (distance + half)
    is_missed = gap > zero and not may_touch
    # |cos| = chord / r
    rounding = wp.where(may_touch, infinity, type(radius)(ROUND) * eps * radius / most(chord, type(radius)(MINIMUM)))
    t_in = wp.where(is_missed, infinity, least(q, other))
    t_out = wp.where(is_missed, -infinity, most(q, other))
    round_in = wp.where(is_missed, zero, rounding * (distance + half + wp.abs(t_in)))
    round_out = wp.where(is_missed, zero, rounding * (distance + half + wp.abs(t_out)))
    return crossing(t_in - round_in, t_in + round_in, t_out - round_out, t_out + round_out)


@wp.func
def ellipsoid_crossing(o: Any, d: Any, radii: Any, eps: Any) -> Any:
    """Crossing of the ellipsoid: the unit sphere after each axis is divided by its radius; t scales by |d / radii|."""
    scaled = wp.cw_div(d, radii)
    scale = wp.length(scaled)
    one = type(scale)(1.0)
    unscaled = sphere_crossing(wp.cw_div(o, radii), scaled / scale, one, type(scale)(0.0), eps)
    return (one / scale) * unscaled


@wp.func
def cylinder_crossing(o: Any, d: Any, radius: Any, half: Any, eps: Any) -> Any:
    """Crossing of the cylinder: the circle x^2 + y^2 = r^2, solved as a sphere in the plane, cut by |z| <= half."""
    zero = type(radius)(0.0)
    flat = wp.vector(d[0], d[1], zero)
    across = wp.vector(o[0], o[1], zero)
    speed = wp.length(flat)
    is_along = speed <= type(radius)(MINIMUM)
    inverse = type(radius)(1.0) / wp.where(is_along, type(radius)(1.0), speed)
    round = inverse * sphere_crossing(across, inverse * flat, radius, zero, eps)
    out = wp.length(across)
    side = crossing_if(is_along, alongside(out - radius, type(radius)(4.0) * eps * out), round)
    return overlap(side, slab_crossing(o[2], d[2], half, eps))


@wp.func
def capsule_crossing(o: Any, d: Any, radius: Any, half: Any, eps: Any) -> Any:
    """Crossing of the capsule: the hull of those of its cylinder and end spheres, whose union is convex."""
    zero = type(half)(0.0)
    end = wp.vector(zero, zero, half)
    ends = hull(sphere_crossing(o - end, d, radius, half, eps), sphere_crossing(o + end, d, radius, half, eps))
    return hull(ends, settled(cylinder_crossing(o, d, radius, half, eps)))


@wp.func
def box_crossing(o: Any, d: Any, half: Any, eps: Any) -> Any:
    """Crossing of the box: the overlap of those of its three slabs."""
    xy = overlap(slab_crossing(o[0], d[0], half[0], eps), slab_crossing(o[1], d[1], half[1], eps))
    return overlap(xy, slab_crossing(o[2], d[2], half[2], eps))
