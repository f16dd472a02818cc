"""The functions of rigcast.kernels.solids over the lanes of a packet."""

from typing import Any

import warp as wp

from rigcast.kernels.solids import (
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    PLANE,
    SPHERE,
    box_normal,
    capsule_normal,
    cylinder_normal,
    ellipsoid_normal,
    intersect_box,
    intersect_capsule,
    intersect_cylinder,
    intersect_ellipsoid,
    intersect_plane,
    intersect_sphere,
    plane_normal,
    sphere_normal,
)

from .packet import LANES, Vectors, lanes


def intersections(intersect: Any) -> Any:
    """intersect(origin, direction, size, cull) for every lane's direction."""

    def over_lanes(origin: wp.vec3, d: Vectors, size: wp.vec3, cull: int) -> lanes:
        x = d.x
        y = d.y
        z = d.z
        t = lanes()
        for i in range(LANES):
            t[i] = intersect(origin, wp.vec3(x[i], y[i], z[i]), size, cull)
        return t

    over_lanes.__name__ = over_lanes.__qualname__ = intersect.func.__name__ + "_over_lanes"
    return wp.func(over_lanes)


def normals(normal: Any) -> Any:
    """normal(point, direction, size) for every lane's point and direction."""

    def over_lanes(p: Vectors, d: Vectors, size: wp.vec3) -> Vectors:
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
            n = normal(wp.vec3(x[i], y[i], z[i]), wp.vec3(d_x[i], d_y[i], d_z[i]), size)
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


intersect_planes = intersections(intersect_plane)
intersect_spheres = intersections(intersect_sphere)
intersect_capsules = intersections(intersect_capsule)
intersect_ellipsoids = intersections(intersect_ellipsoid)
intersect_cylinders = intersections(intersect_cylinder)
intersect_boxes = intersections(intersect_box)
plane_normals = normals(plane_normal)
sphere_normals = normals(sphere_normal)
capsule_normals = normals(capsule_normal)
ellipsoid_normals = normals(ellipsoid_normal)
cylinder_normals = normals(cylinder_normal)
box_normals = normals(box_normal)


@wp.func
def intersect_closed_forms(kind: int, size: wp.vec3, origin: wp.vec3, d: Vectors, cull: int) -> lanes:
    if kind == PLANE:
        return intersect_planes(origin, d, size, cull)
    if kind == SPHERE:
        return intersect_spheres(origin, d, size, cull)
    if kind == CAPSULE:
        return intersect_capsules(origin, d, size, cull)
    if kind == ELLIPSOID:
        return intersect_ellipsoids(origin, d, size, cull)
    if kind == CYLINDER:
        return intersect_cylinders(origin, d, size, cull)
    return intersect_boxes(origin, d, size, cull)


@wp.func
def closed_form_normals(kind: int, size: wp.vec3, p: Vectors, d: Vectors) -> Vectors:
    if kind == PLANE:
        return plane_normals(p, d, size)
    if kind == SPHERE:
        return sphere_normals(p, d, size)
    if kind == CAPSULE:
        return capsule_normals(p, d, size)
    if kind == ELLIPSOID:
        return ellipsoid_normals(p, d, size)
    if kind == CYLINDER:
        return cylinder_normals(p, d, size)
    return box_normals(p, d, size)
