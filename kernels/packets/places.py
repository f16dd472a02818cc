"""Where the rays of a packet hit: rigcast.kernels.hits.place_of over lanes, for one shape at a time."""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits import distance_of, distance_to_plane, middle, outward
from rigcast.kernels.poses import pose_of
from rigcast.kernels.solids import has_triangles
from rigcast.kernels.tree import WIDTH
from rigcast.kernels.triangle import GRAZING
from rigcast.kernels.vectors import to_double, to_float

from .packet import LANES, TileRays, Vectors, int_lanes, lanes, world_ray
from .solids import closed_form_normals


@wp.struct
class Places:
    """As Place, for every ray of a packet that hits one shape; of no use for the others."""

    distance: lanes
    face: int_lanes
    normal: Vectors


@wp.func
def places_on_shape(g: Geometry, rays: TileRays, slot: int, shape: int) -> Places:
    if has_triangles(g.kind[shape]):
        return places_on_triangles(g, rays, slot, shape)
    return places_on_closed_form(g, rays, slot, shape)


@wp.func
def places_on_triangles(g: Geometry, rays: TileRays, slot: int, shape: int) -> Places:
    x = rays.directions[slot].x
    y = rays.directions[slot].y
    z = rays.directions[slot].z
    shapes = rays.best[slot].shape
    triangle = rays.best[slot].triangle
    kind = g.kind[shape]
    pose = pose_of(g, shape, rays.scope)
    rotation = pose.rotation
    offset = rays.origin - pose.position
    face = int_lanes()
    local_x = lanes()
    local_y = lanes()
    local_z = lanes()
    vertex_x = lanes()
    vertex_y = lanes()
    vertex_z = lanes()
    for i in range(LANES):
        block = triangle[i] / WIDTH
        j = triangle[i] % WIDTH
        face[i] = g.blocks[block].face[j]
        local_x[i] = g.blocks[block].normal_x[j]
        local_y[i] = g.blocks[block].normal_y[j]
        local_z[i] = g.blocks[block].normal_z[j]
        vertex_x[i] = g.blocks[block].x0[j]
        vertex_y[i] = g.blocks[block].y0[j]
        vertex_z[i] = g.blocks[block].z0[j]
    distance = lanes()
    normal_x = lanes()
    normal_y = lanes()
    normal_z = lanes()
    grazing = int(0)
    for i in range(LANES):
        n = wp.vec3(local_x[i], local_y[i], local_z[i])
        normal = rotation * to_double(n)
        slope = wp.dot(wp.vec3d(x[i], y[i], z[i]), normal)
        v0 = wp.vec3(vertex_x[i], vertex_y[i], vertex_z[i])
        distance[i] = distance_to_plane(v0, n, normal, slope, offset)
        facing = outward(kind, normal, slope)
        normal_x[i] = facing[0]
        normal_y[i] = facing[1]
        normal_z[i] = facing[2]
        is_grazing = wp.where(wp.abs(slope) <= wp.float64(GRAZING), 1, 0) & wp.where(shapes[i] == shape, 1, 0)
        grazing = grazing | (is_grazing << i)
    for i in range(LANES):
        if grazing & (1 << i) != 0:
            distance[i] = float(distance_of(g, shape, triangle[i], world_ray(rays, slot, i)))
    return places(distance, face, vectors(normal_x, normal_y, normal_z))


@wp.func
def places_on_closed_form(g: Geometry, rays: TileRays, slot: int, shape: int) -> Places:
    x = rays.directions[slot].x
    y = rays.directions[slot].y
    z = rays.directions[slot].z
    near = rays.best[slot].near
    far = rays.best[slot].far
    pose = pose_of(g, shape, rays.scope)
    rotation = pose.rotation
    to_local = wp.transpose(rotation)
    offset = rays.origin - pose.position
    distance = lanes()
    point_x = lanes()
    point_y = lanes()
    point_z = lanes()
    direction_x = lanes()
    direction_y = lanes()
    direction_z = lanes()
    for i in range(LANES):
        d = wp.vec3d(x[i], y[i], z[i])
        distance[i] = middle(near[i], far[i])
        point = to_float(to_local * (offset + wp.float64(distance[i]) * d))
        direction = to_float(to_local * d)
        point_x[i] = point[0]
        point_y[i] = point[1]
        point_z[i] = point[2]
        direction_x[i] = direction[0]
        direction_y[i] = direction[1]
        direction_z[i] = direction[2]
    points = vectors(point_x, point_y, point_z)
    directions = vectors(direction_x, direction_y, direction_z)
    local = closed_form_normals(g.kind[shape], g.size[rays.scope.first_shape + shape], points, directions, distance)
    local_x = local.x
    local_y = local.y
    local_z = local.z
    face = int_lanes()
    for i in range(LANES):
        normal = to_float(rotation * to_double(wp.vec3(local_x[i], local_y[i], local_z[i])))
        point_x[i] = normal[0]
        point_y[i] = normal[1]
        point_z[i] = normal[2]
        face[i] = -1
    return places(distance, face, vectors(point_x, point_y, point_z))


@wp.func
def vectors(x: lanes, y: lanes, z: lanes) -> Vectors:
    made = Vectors()
    made.x = x
    made.y = y
    made.z = z
    return made


@wp.func
def places(distance: lanes, face: int_lanes, normal: Vectors) -> Places:
    made = Places()
    made.distance = distance
    made.face = face
    made.normal = normal
    return made
