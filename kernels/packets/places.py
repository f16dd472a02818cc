"""Where the rays of a packet hit, as rigcast.kernels.hits.place_of has it, for one shape at a time.

It is written at once to where the tile's hits are staged: to hand it on would be to copy a dozen arrays of lanes.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits import NO_SHAPE, distance_of, height_above, middle, outward
from rigcast.kernels.out import Out, read_hit, write_place
from rigcast.kernels.poses import pose_of
from rigcast.kernels.shapes.facets import facet_at
from rigcast.kernels.shapes.solids import has_triangles
from rigcast.kernels.shapes.triangle import GRAZING
from rigcast.kernels.vectors import larger, lowest_bit, to_double, to_float

from .lanes import lane_bits
from .packet import ALL_LANES, LANES, TileRays, Vectors, int_lanes, lanes, world_ray
from .solids import closed_form_normals


@wp.func
def write_triangles(g: Geometry, staged: Out, rays: wp.array[TileRays], k: int, which: int, shape: int) -> None:
    """Where those rays of a packet hit which hit triangles of one shape."""
    slot = rays[0].first_slot + k
    x = rays[0].directions[slot].x
    y = rays[0].directions[slot].y
    z = rays[0].directions[slot].z
    hit = rays[0].best[slot].triangle
    kind = g.kind[shape]
    pose = pose_of(rays[0].geometry, shape, rays[0].scope)
    rotation = pose.rotation
    offset = rays[0].origin - pose.position
    todo = int(which)
    while todo != 0:
        triangle = hit[lowest_bit(todo)]
        same = todo & lanes_at(hit, triangle)
        todo = todo & ~same
        facet = facet_at(rays[0].geometry, rays[0].scope.first_shape + shape, triangle)
        normal = rotation * facet.normal
        height = height_above(facet, normal, offset)
        unit_normal = normal * facet.scale
        while same != 0:
            i = lowest_bit(same)
            same = same & (same - 1)
            slope = wp.dot(wp.vec3d(x[i], y[i], z[i]), normal)
            distance = larger(float(height / slope), 0.0)
            if wp.abs(slope) * facet.scale <= wp.float64(GRAZING):
                distance = float(distance_of(rays[0].geometry, shape, triangle, world_ray(rays, slot, i)))
            facing = outward(kind, unit_normal, slope)
            write_place(staged, k * LANES + i, shape, distance, facet.face, facing, rays[0].limit)


@wp.func
def write_closed_form(g: Geometry, staged: Out, rays: wp.array[TileRays], k: int, which: int, shape: int) -> None:
    """Where those rays of a packet hit which hit one closed form; normals are worked out for all rays at once."""
    slot = rays[0].first_slot + k
    x = rays[0].directions[slot].x
    y = rays[0].directions[slot].y
    z = rays[0].directions[slot].z
    near = rays[0].best[slot].near
    far = rays[0].best[slot].far
    pose = pose_of(rays[0].geometry, shape, rays[0].scope)
    rotation = pose.rotation
    to_local = wp.transpose(rotation)
    offset = rays[0].origin - pose.position
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
    local = closed_form_normals(g.kind[shape], g.size[rays[0].scope.first_shape + shape], points, directions, distance)
    local_x = local.x
    local_y = local.y
    local_z = local.z
    normal_x = lanes()
    normal_y = lanes()
    normal_z = lanes()
    for i in range(LANES):
        normal = to_float(rotation * to_double(wp.vec3(local_x[i], local_y[i], local_z[i])))
        normal_x[i] = normal[0]
        normal_y[i] = normal[1]
        normal_z[i] = normal[2]
    todo = int(which)
    while todo != 0:
        i = lowest_bit(todo)
        todo = todo & (todo - 1)
        facing = wp.vec3(normal_x[i], normal_y[i], normal_z[i])
        write_place(staged, k * LANES + i, shape, distance[i], -1, facing, rays[0].limit)


@wp.func
def vectors(x: lanes, y: lanes, z: lanes) -> Vectors:
    made = Vectors()
    made.x = x
    made.y = y
    made.z = z
    return made


@wp.func
def lanes_at(numbers: int_lanes, number: int) -> int:
    """Bit by bit, which of these is the number."""
    same = int_lanes()
    for i in range(LANES):
        same[i] = wp.where(numbers[i] == number, -1, 0)
    return lane_bits(same)


@wp.func
def write_packet(g: Geometry, staged: Out, rays: wp.array[TileRays], k: int) -> None:
    """Write what the rays of a packet hit, shape by shape, where their misses are."""
    slot = rays[0].first_slot + k
    shapes = rays[0].best[slot].shape
    todo = ALL_LANES & ~lanes_at(shapes, NO_SHAPE)
    while todo != 0:
        shape = shapes[lowest_bit(todo)]
        same = todo & lanes_at(shapes, shape)
        todo = todo & ~same
        if has_triangles(g.kind[shape]):
            write_triangles(g, staged, rays, k, same, shape)
        else:
            write_closed_form(g, staged, rays, k, same, shape)


@wp.func
def read_packet(staged: Out, rays: wp.array[TileRays], k: int) -> None:
    for lane in range(LANES):
        read_hit(staged, k * LANES + lane, rays[0].rotation)
