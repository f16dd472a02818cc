"""The functions of rigcast.kernels.shapes.solids and solid_normals, applied to all lanes of a packet."""

from typing import Any

import warp as wp

from rigcast.kernels.packets.packet import LANES, Vectors, lanes
from rigcast.kernels.shapes.solid_normals import (
    box_normal,
    capsule_normal,
    cylinder_normal,
    ellipsoid_normal,
    plane_normal,
    sphere_normal,
)
from rigcast.kernels.shapes.solids import (
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    EPS,
    PLANE,
    SPHERE,
    meet_box,
    meet_capsule,
    meet_cylinder,
    meet_ellipsoid,
    meet_plane,
    meet_sphere,
)


@wp.struct
class LaneSpans:
    """Interval [near, far] of each ray's distance to one shape."""

    near: lanes
    far: lanes


def triages(meet: Any) -> Any:
    """A Warp function that applies meet(origin, d, size, cull, EPS), in float32, to every lane."""

    def over_lanes(origin: wp.vec3, d: Vectors, size: wp.vec3, cull: int) -> LaneSpans:
        x = d.x
        y = d.y
        z = d.z
        near = lanes()
        far = lanes()
        for i in range(LANES):
            span = meet(origin, wp.vec3(x[i], y[i], z[i]), size, cull, EPS)
            near[i] = span[0]
            far[i] = span[1]
        spans = LaneSpans()
        spans.near = near
        spans.far = far
        return spans

    over_lanes.__name__ = over_lanes.__qualname__ = meet.func.__name__ + "_over_lanes"
    return wp.func(over_lanes)


def normals(normal: Any) -> Any:
    """A Warp function that applies normal(point, direction, distance, size) to every lane."""

    def over_lanes(p: Vectors, d: Vectors, t: lanes, size: wp.vec3) -> Vectors:
        x = p.x
        y = p.y
        z = p.z
        d_x = d.x
        d_y = d.y
        d_z = d.z
        normal_x = lanes()
        normal_y = lanes()
        normal_z = lanes()
        for i in range(LANES):
            n = normal(wp.vec3(x[i], y[i], z[i]), wp.vec3(d_x[i], d_y[i], d_z[i]), t[i], size)
            normal_x[i] = n[0]
            normal_y[i] = n[1]
            normal_z[i] = n[2]
        found = Vectors()
        found.x = normal_x
        found.y = normal_y
        found.z = normal_z
        return found

    over_lanes.__name__ = over_lanes.__qualname__ = normal.func.__name__ + "_over_lanes"
    return wp.func(over_lanes)


triage_planes = triages(meet_plane)
triage_spheres = triages(meet_sphere)
triage_capsules = triages(meet_capsule)
triage_ellipsoids = triages(meet_ellipsoid)
triage_cylinders = triages(meet_cylinder)
triage_boxes = triages(meet_box)
plane_normals = normals(plane_normal)
sphere_normals = normals(sphere_normal)
capsule_normals = normals(capsule_normal)
ellipsoid_normals = normals(ellipsoid_normal)
cylinder_normals = normals(cylinder_normal)
box_normals = normals(box_normal)


@wp.func
def triage_closed_forms(kind: int, size: wp.vec3, origin: wp.vec3, d: Vectors, cull: int) -> LaneSpans:
    if kind == PLANE:
        return triage_planes(origin, d, size, cull)
    if kind == SPHERE:
        return triage_spheres(origin, d, size, cull)
    if kind == CAPSULE:
        return triage_capsules(origin, d, size, cull)
    if kind == ELLIPSOID:
        return triage_ellipsoids(origin, d, size, cull)
    if kind == CYLINDER:
        return triage_cylinders(origin, d, size, cull)
    return triage_boxes(origin, d, size, cull)


@wp.func
def closed_form_normals(kind: int, size: wp.vec3, p: Vectors, d: Vectors, t: lanes) -> Vectors:
    if kind == PLANE:
        return plane_normals(p, d, t, size)
    if kind == SPHERE:
        return sphere_normals(p, d, t, size)
    if kind == CAPSULE:
        return capsule_normals(p, d, t, size)
    if kind == ELLIPSOID:
        return ellipsoid_normals(p, d, t, size)
    if kind == CYLINDER:
        return cylinder_normals(p, d, t, size)
    return box_normals(p, d, t, size)
