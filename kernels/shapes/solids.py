"""A ray against MuJoCo's closed-form geoms, in the geom's own frame and with the rules of MuJoCo's `mju_rayGeom`.

Spheres, capsules, ellipsoids, cylinders and boxes are convex solids. A ray o + t d is inside one for t in
[t_in, t_out], or never (t_in > t_out). It hits where it enters or, from inside, where it leaves. A touch counts as a
hit, and so does an origin on the surface (t = 0). At t_in the ray opposes the outward normal, at t_out it follows it;
culling needs no more than this.

A plane is not a solid: it has one side and is hit only from above.

Sizes are MuJoCo's `geom_size`: sphere (radius), capsule and cylinder (radius, half length along z), ellipsoid (the
three radii), box (the three half sizes), plane (half sizes along x and y, 0 where infinite).

As for triangles there are two stages. `triage_closed_form` computes an interval that contains the distance, in float32,
or reports that it cannot tell: at a touch, at a crease, along a face, with the origin on the surface. Those cases go to
`decide_closed_form`, in float64. Both use the same functions, with eps that of float32, or 0.
"""

from typing import Any

import warp as wp

from rigcast.kernels.vectors import Interval, to_double

from .crossings import (
    MINIMUM,
    box_crossing,
    capsule_crossing,
    cylinder_crossing,
    ellipsoid_crossing,
    least,
    most,
    sphere_crossing,
)
from .triangle import CULL_BACK, CULL_FRONT

PLANE = wp.constant(0)
SPHERE = wp.constant(1)
CAPSULE = wp.constant(2)
ELLIPSOID = wp.constant(3)
CYLINDER = wp.constant(4)
BOX = wp.constant(5)
TRIANGLES = wp.constant(6)
SHEET = wp.constant(7)  # triangles with two outer sides: the normal points to the side from which the ray comes

EPS = wp.constant(2.0**-23)
EXACT = wp.constant(wp.float64(0.0))
LARGEST = wp.constant(3.4028234663852886e38)
"""The largest finite float32."""
WIDE = wp.constant(1024.0)  # in eps (|o| + t): wider spans, of grazing rays, are left to float64


@wp.func
def has_triangles(kind: int) -> bool:
    """Whether a shape of this kind is a tree of triangles, not a closed form."""
    return kind >= TRIANGLES


# ---- spans: [near, far] contains the distance; +inf, +inf on a miss; 0, +inf where float32 cannot tell


@wp.func
def span(near: Any, far: Any) -> Any:
    return wp.vector(near, far, far, far, far)


@wp.func
def hit_of_crossing(t_in: Any, t_out: Any, first_in: Any, first_out: Any) -> Any:
    """First hit of a ray that enters a solid at t_in and leaves it at t_out: t_in, else t_out, else +inf.

    t_in counts from first_in on, t_out from first_out on; +inf for either drops it by culling.
    """
    infinity = type(t_in)(wp.inf)
    return wp.where(t_in >= first_in, t_in, wp.where(t_out >= first_out, t_out, infinity))


@wp.func
def first_hit(c: Any, cull: int, o: Any, eps: Any) -> Any:
    """The span of the first hit of a ray with the crossing c.

    Cases that float32 cannot tell are given an infinite width. wp.where between numbers becomes vector instructions;
    `and` and `or` do not.
    """
    infinity = type(eps)(wp.inf)
    zero = type(eps)(0.0)
    first_in = wp.where(cull == CULL_FRONT, infinity, zero)
    first_out = wp.where(cull == CULL_BACK, infinity, zero)
    near = hit_of_crossing(c[0], c[2], first_in, first_out)
    far = hit_of_crossing(c[1], c[3], first_in, first_out)
    width = wp.where(c[1] <= c[2], far - near, infinity)
    width = wp.where(c[0] >= zero, width, wp.where(c[1] < zero, width, infinity))
    width = wp.where(c[2] >= zero, width, wp.where(c[3] < zero, width, infinity))
    widest = least(type(eps)(WIDE) * eps * (wp.abs(o[0]) + wp.abs(o[1]) + wp.abs(o[2]) + near), type(eps)(LARGEST))
    low = wp.where(width > widest, zero, near)
    high = wp.where(width > widest, infinity, far)
    end = wp.where(c[0] > c[3], -infinity, c[3])  # a missed solid counts as behind the ray
    return span(wp.where(end < zero, infinity, low), wp.where(end < zero, infinity, high))


@wp.func
def beyond_edge(p: Any, size: Any) -> Any:
    """Distance of p beyond the edge of a plane, negative inside; -inf for an unbounded plane (size 0)."""
    return wp.where(size <= type(p)(0.0), type(p)(-wp.inf), wp.abs(p) - size)


@wp.func
def meet_plane(o: Any, d: Any, size: Any, cull: int, eps: Any) -> Any:
    """Span of a ray's hit on the plane z = 0 from above; a miss from below, off its rectangle, or if culled."""
    infinity = type(eps)(wp.inf)
    zero = type(eps)(0.0)
    t = -o[2] / d[2]
    is_above = d[2] < -type(eps)(MINIMUM) and o[2] >= zero and cull != CULL_FRONT
    gap = most(beyond_edge(o[0] + t * d[0], size[0]), beyond_edge(o[1] + t * d[1], size[1]))
    rounding = type(eps)(3.0) * eps * (wp.abs(o[0]) + wp.abs(o[1]) + t)
    is_met = is_above and gap <= rounding
    is_sure = gap <= -rounding
    near = wp.where(is_sure, t - type(eps)(2.0) * eps * t, zero)
    far = wp.where(is_sure, t + type(eps)(2.0) * eps * t, infinity)
    return span(wp.where(is_met, near, infinity), wp.where(is_met, far, infinity))


@wp.func
def meet_sphere(o: Any, d: Any, size: Any, cull: int, eps: Any) -> Any:
    return first_hit(sphere_crossing(o, d, size[0], type(eps)(0.0), eps), cull, o, eps)


@wp.func
def meet_capsule(o: Any, d: Any, size: Any, cull: int, eps: Any) -> Any:
    return first_hit(capsule_crossing(o, d, size[0], size[1], eps), cull, o, eps)


@wp.func
def meet_ellipsoid(o: Any, d: Any, size: Any, cull: int, eps: Any) -> Any:
    return first_hit(ellipsoid_crossing(o, d, size, eps), cull, o, eps)


@wp.func
def meet_cylinder(o: Any, d: Any, size: Any, cull: int, eps: Any) -> Any:
    return first_hit(cylinder_crossing(o, d, size[0], size[1], eps), cull, o, eps)


@wp.func
def meet_box(o: Any, d: Any, size: Any, cull: int, eps: Any) -> Any:
    return first_hit(box_crossing(o, d, size, eps), cull, o, eps)


@wp.func
def closed_form_crossing(kind: int, o: Any, d: Any, size: Any, eps: Any) -> Any:
    """Crossing of a ray with a closed form other than a plane."""
    if kind == SPHERE:
        return sphere_crossing(o, d, size[0], type(eps)(0.0), eps)
    if kind == CAPSULE:
        return capsule_crossing(o, d, size[0], size[1], eps)
    if kind == ELLIPSOID:
        return ellipsoid_crossing(o, d, size, eps)
    if kind == CYLINDER:
        return cylinder_crossing(o, d, size[0], size[1], eps)
    return box_crossing(o, d, size, eps)


@wp.func
def meet_closed_form(kind: int, o: Any, d: Any, size: Any, cull: int, eps: Any) -> Any:
    if kind == PLANE:
        return meet_plane(o, d, size, cull, eps)
    return first_hit(closed_form_crossing(kind, o, d, size, eps), cull, o, eps)


@wp.func
def triage_closed_form(kind: int, size: wp.vec3, o: wp.vec3, d: wp.vec3, cull: int) -> Interval:
    """Interval of the distance along the unit direction d to a closed-form geom.

    (+inf, +inf) on a sure miss, (0, +inf) where rounding could turn a miss into a hit or choose another surface.
    """
    return meet_closed_form(kind, o, d, size, cull, EPS)


@wp.func
def decide_closed_form(kind: int, size: wp.vec3, o: wp.vec3d, d: wp.vec3d, cull: int) -> wp.float64:
    """Distance to a closed-form geom in float64; +inf on a miss."""
    return meet_closed_form(kind, o, d, to_double(size), cull, EXACT)[0]
