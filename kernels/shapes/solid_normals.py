"""The outward normals of MuJoCo's closed-form geoms, in the geom's own frame; sizes as in `solids`."""

import warp as wp

from rigcast.kernels.vectors import larger, smaller

from .solids import BOX, CAPSULE, CYLINDER, ELLIPSOID, SPHERE

PLACE_ROUNDING = wp.constant(2.0**-22)


@wp.func
def normalized(a: wp.vec3) -> wp.vec3:
    """The vector at unit length; 0 stays 0."""
    length = wp.length(a)
    return a * wp.where(length > 0.0, 1.0 / length, 0.0)


@wp.func
def plane_normal(p: wp.vec3, d: wp.vec3, t: float, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    return wp.vec3(0.0, 0.0, 1.0)


@wp.func
def sphere_normal(p: wp.vec3, d: wp.vec3, t: float, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    return normalized(p)


@wp.func
def capsule_normal(p: wp.vec3, d: wp.vec3, t: float, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    return normalized(wp.vec3(p[0], p[1], p[2] - larger(-size[1], smaller(p[2], size[1]))))


@wp.func
def ellipsoid_normal(p: wp.vec3, d: wp.vec3, t: float, size: wp.vec3) -> wp.vec3:  # noqa: ARG001
    """Normal along the gradient of (x / a)^2 + (y / b)^2 + (z / c)^2, scaled against overflow."""
    return normalized(wp.cw_div(wp.cw_div(p, size), size / wp.max(size)))


@wp.func
def face_score(gap: float, speed: float, rounding: float) -> float:
    """Score of a face as the one that a ray crosses at a point; the highest score wins.

    gap: distance [m] of the point from the face's plane. speed: d . n. Among faces within rounding of the point, the
    one that the ray meets most steeply wins; else the nearest.
    """
    return wp.where(wp.abs(gap) <= rounding, wp.abs(speed), -wp.abs(gap))


@wp.func
def cylinder_normal(p: wp.vec3, d: wp.vec3, t: float, size: wp.vec3) -> wp.vec3:
    """Normal of the surface that the ray crosses, side or cap."""
    out = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    per_out = wp.where(out > 0.0, 1.0 / out, 0.0)
    rounding = PLACE_ROUNDING * (t + size[0] + size[1])
    side = face_score(out - size[0], (p[0] * d[0] + p[1] * d[1]) * per_out, rounding)
    cap = face_score(wp.abs(p[2]) - size[1], d[2], rounding)
    on_side = wp.where(cap > side, 0.0, per_out)
    return wp.vec3(p[0] * on_side, p[1] * on_side, wp.where(cap > side, wp.sign(p[2]), 0.0))


@wp.func
def box_normal(p: wp.vec3, d: wp.vec3, t: float, size: wp.vec3) -> wp.vec3:
    """Normal of the face that the ray crosses."""
    rounding = PLACE_ROUNDING * (t + size[0] + size[1] + size[2])
    x = face_score(wp.abs(p[0]) - size[0], d[0], rounding)
    y = face_score(wp.abs(p[1]) - size[1], d[1], rounding)
    z = face_score(wp.abs(p[2]) - size[2], d[2], rounding)
    on_x = wp.where(x >= y, wp.where(x >= z, 1.0, 0.0), 0.0)
    on_y = wp.where(y >= z, 1.0 - on_x, 0.0)
    return wp.vec3(on_x * wp.sign(p[0]), on_y * wp.sign(p[1]), (1.0 - on_x - on_y) * wp.sign(p[2]))


@wp.func
def closed_form_normal(kind: int, size: wp.vec3, p: wp.vec3, d: wp.vec3, t: float) -> wp.vec3:
    """Unit outward normal of a closed-form geom at the point p where a ray along the unit vector d hits it.

    t: distance of p from the ray's origin [m], by which the rounding of p grows.
    """
    if kind == SPHERE:
        return sphere_normal(p, d, t, size)
    if kind == CAPSULE:
        return capsule_normal(p, d, t, size)
    if kind == ELLIPSOID:
        return ellipsoid_normal(p, d, t, size)
    if kind == CYLINDER:
        return cylinder_normal(p, d, t, size)
    if kind == BOX:
        return box_normal(p, d, t, size)
    return plane_normal(p, d, t, size)
