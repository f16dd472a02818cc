"""Distance, face and normal of each hit of a packet, one shape at a time; the same as hits.hit.place_of per ray."""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits.hit import NO_SHAPE, distance_of, middle
from rigcast.kernels.hits.out import Out
from rigcast.kernels.packets.intersect.solids import closed_form_normals
from rigcast.kernels.packets.lanes import lane_bits
from rigcast.kernels.packets.packet import (
    ALL_LANES,
    LANES,
    TileRays,
    Vectors,
    double_lanes,
    int_lanes,
    lanes,
    round_vectors,
    world_ray,
)
from rigcast.kernels.poses.scope import pose_of
from rigcast.kernels.shapes.facets import FIRST_IN_PATCHES, facet_at
from rigcast.kernels.shapes.solids import LARGEST, PLANE, SHEET, has_triangles
from rigcast.kernels.shapes.triangle import GRAZING
from rigcast.kernels.vectors import larger, lowest_bit, smaller, to_double

from .staging import PacketOut
from .taken import Places, take_distance, take_facet, take_places


@wp.func
def scales_of(last: int, number: int_lanes, x: double_lanes, y: double_lanes, z: double_lanes) -> double_lanes:
    """Per lane 1 / the length of the normal (x, y, z) of a triangle, as in Facet; stored normals count as unit.

    number: of each lane's triangle. last: the largest of these numbers.
    """
    scale = double_lanes()
    if last >= FIRST_IN_PATCHES:
        for i in range(LANES):
            by_length = wp.float64(1.0) / wp.length(wp.vec3d(x[i], y[i], z[i]))
            scale[i] = wp.where(number[i] >= FIRST_IN_PATCHES, by_length, wp.float64(1.0))
    else:
        for i in range(LANES):
            scale[i] = wp.float64(1.0)
    return scale


@wp.func
def take_facets(rays: wp.array[TileRays], hit: int_lanes, which: int, shape: int) -> int:
    """Write the plane and face hit by each lane of `which` to the tile's facets; return the largest triangle number."""
    last = int(0)
    todo = int(which)
    while todo != 0:
        triangle = hit[lowest_bit(todo)]
        todo = todo & ~lanes_at(hit, triangle)
        last = wp.max(last, triangle)
        facet = facet_at(rays[0].geometry, rays[0].scope.first_shape + shape, triangle)
        height = wp.dot(to_double(facet.corner), facet.normal)
        take_facet(rays[0].facets, hit, triangle, height, facet.normal, facet.face)
    return last


@wp.func
def place_triangles(
    g: Geometry, rays: wp.array[TileRays], places: wp.array[Places], k: int, which: int, shape: int
) -> None:
    """Place the hits of those lanes (`which`, a bit mask) of packet k that hit triangles of one shape."""
    slot = rays[0].first_slot + k
    x = rays[0].directions[slot].x
    y = rays[0].directions[slot].y
    z = rays[0].directions[slot].z
    hit = rays[0].best[slot].triangle
    facets = rays[0].facets
    last = take_facets(rays, hit, which, shape)
    pose = pose_of(rays[0].geometry, shape, rays[0].scope)
    rotation = pose.rotation
    offset = rays[0].origin - pose.position
    heights = facets[0].height
    normal_x = facets[0].normal_x
    normal_y = facets[0].normal_y
    normal_z = facets[0].normal_z
    scales = scales_of(last, hit, normal_x, normal_y, normal_z)
    is_sheet = g.kind[shape] == SHEET
    distances = double_lanes()
    grazing = double_lanes()  # below 0 where the distance must be computed in float64
    for i in range(LANES):
        normal = rotation * wp.vec3d(normal_x[i], normal_y[i], normal_z[i])
        slope = wp.dot(wp.vec3d(x[i], y[i], z[i]), normal)
        distances[i] = (heights[i] - wp.dot(offset, normal)) / slope
        is_grazing = wp.abs(slope) * scales[i] <= wp.float64(GRAZING)
        grazing[i] = wp.where(is_grazing, wp.float64(-1.0), wp.float64(1.0))
        outward = wp.where(is_sheet and slope > wp.float64(0.0), wp.float64(-1.0), wp.float64(1.0))
        unit = normal * scales[i]
        normal_x[i] = outward * unit[0]
        normal_y[i] = outward * unit[1]
        normal_z[i] = outward * unit[2]
    local = rays[0].local
    round_vectors(local, distances, grazing, grazing)
    distance = local[0].x
    rounded = local[0].y
    are_grazing = int_lanes()
    for i in range(LANES):
        distance[i] = larger(distance[i], 0.0)
        are_grazing[i] = wp.where(rounded[i] < 0.0, -1, 0)
    round_vectors(local, normal_x, normal_y, normal_z)
    take_places(places, k, rays[0].best[slot].shape, shape, distance, facets[0].face, local)
    todo = which & lane_bits(are_grazing)
    while todo != 0:
        i = lowest_bit(todo)
        todo = todo & (todo - 1)
        ray = world_ray(rays, slot, i)
        take_distance(places, k, i, float(distance_of(rays[0].geometry, shape, hit[i], ray)))


@wp.func
def place_closed_form(g: Geometry, rays: wp.array[TileRays], places: wp.array[Places], k: int, shape: int) -> None:
    """Place the hits of those lanes of packet k that hit one closed form; computes all lanes, takes those that hit."""
    slot = rays[0].first_slot + k
    near = rays[0].best[slot].near
    far = rays[0].best[slot].far
    distance = lanes()
    for i in range(LANES):
        distance[i] = middle(near[i], far[i])
    rotation = pose_of(rays[0].geometry, shape, rays[0].scope).rotation
    x = lanes()
    y = lanes()
    z = lanes()
    if g.kind[shape] != PLANE:
        local = local_normals(g, rays, slot, shape, distance)
        x = local.x
        y = local.y
        z = local.z
    else:
        for i in range(LANES):
            z[i] = 1.0
    turn(rays[0].local, rotation, x, y, z)
    take_places(places, k, rays[0].best[slot].shape, shape, distance, int_lanes(-1), rays[0].local)


@wp.func
def local_normals(g: Geometry, rays: wp.array[TileRays], slot: int, shape: int, distance: lanes) -> Vectors:
    """Normals of a closed form, in its own frame, at these distances along the rays of a packet."""
    x = rays[0].directions[slot].x
    y = rays[0].directions[slot].y
    z = rays[0].directions[slot].z
    pose = pose_of(rays[0].geometry, shape, rays[0].scope)
    to_local = wp.transpose(pose.rotation)
    origin = to_local * (rays[0].origin - pose.position)
    point_x = double_lanes()
    point_y = double_lanes()
    point_z = double_lanes()
    direction_x = double_lanes()
    direction_y = double_lanes()
    direction_z = double_lanes()
    for i in range(LANES):
        direction = to_local * wp.vec3d(x[i], y[i], z[i])
        point = origin + wp.float64(distance[i]) * direction
        point_x[i] = point[0]
        point_y[i] = point[1]
        point_z[i] = point[2]
        direction_x[i] = direction[0]
        direction_y[i] = direction[1]
        direction_z[i] = direction[2]
    round_vectors(rays[0].local, direction_x, direction_y, direction_z)
    directions = rays[0].local[0]
    round_vectors(rays[0].local, point_x, point_y, point_z)
    size = g.size[rays[0].scope.first_shape + shape]
    return closed_form_normals(g.kind[shape], size, rays[0].local[0], directions, distance)


@wp.func
def turn(turned: wp.array[Vectors], rotation: wp.mat33d, x: lanes, y: lanes, z: lanes) -> None:
    """Rotate the vectors of a packet in float64 and round them to float32."""
    turned_x = double_lanes()
    turned_y = double_lanes()
    turned_z = double_lanes()
    for i in range(LANES):
        vector = rotation * to_double(wp.vec3(x[i], y[i], z[i]))
        turned_x[i] = vector[0]
        turned_y[i] = vector[1]
        turned_z[i] = vector[2]
    round_vectors(turned, turned_x, turned_y, turned_z)


@wp.func
def lanes_at(numbers: int_lanes, number: int) -> int:
    """Bit mask of the lanes whose number is `number`."""
    same = int_lanes()
    for i in range(LANES):
        same[i] = wp.where(numbers[i] == number, -1, 0)
    return lane_bits(same)


@wp.func
def place_packet(g: Geometry, rays: wp.array[TileRays], places: wp.array[Places], k: int) -> None:
    """Compute where the rays of packet k hit, shape by shape."""
    places[k] = Places()
    shapes = rays[0].best[rays[0].first_slot + k].shape
    todo = ALL_LANES & ~lanes_at(shapes, NO_SHAPE)
    while todo != 0:
        shape = shapes[lowest_bit(todo)]
        same = todo & lanes_at(shapes, shape)
        todo = todo & ~same
        if has_triangles(g.kind[shape]):
            place_triangles(g, rays, places, k, same, shape)
        else:
            place_closed_form(g, rays, places, k, shape)


@wp.func
def stage_packet(
    staged: wp.array[PacketOut], rays: wp.array[TileRays], places: wp.array[Places], k: int, out: Out
) -> None:
    """Stage the hits of packet k, or its readings if `out.is_read`; see rigcast.kernels.hits.out."""
    x = places[k].normal_x
    y = places[k].normal_y
    z = places[k].normal_z
    if out.is_read:
        turn(rays[0].local, wp.transpose(rays[0].rotation), x, y, z)
        x = rays[0].local[0].x
        y = rays[0].local[0].y
        z = rays[0].local[0].z
    distance = places[k].distance
    face = places[k].face
    shape = rays[0].best[rays[0].first_slot + k].shape
    farthest = smaller(rays[0].limit, LARGEST)
    nearest = wp.where(out.is_read, out.min_range, 0.0)
    for i in range(LANES):
        t = wp.where(shape[i] == NO_SHAPE, wp.inf, distance[i])
        is_hit = t <= farthest
        is_near = t < nearest
        distance[i] = wp.where(is_hit, wp.where(is_near, -wp.inf, t), wp.inf)
        face[i] = wp.where(is_hit, face[i], -1)
        shape[i] = wp.where(is_hit, wp.where(is_near, -1, shape[i]), -1)
        x[i] = wp.where(shape[i] < 0, 0.0, x[i])
        y[i] = wp.where(shape[i] < 0, 0.0, y[i])
        z[i] = wp.where(shape[i] < 0, 0.0, z[i])
    staged[k].distance = distance
    staged[k].shape = shape
    staged[k].face = face
    staged[k].normal_x = x
    staged[k].normal_y = y
    staged[k].normal_z = z
