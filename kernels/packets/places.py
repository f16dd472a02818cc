"""Where the rays of a packet hit, as rigcast.kernels.hits.hit.place_of has it, for one shape at a time.

What is worked out for all rays at once goes to those that hit a shape by `or`, which begins with 0: of a choice between
what was there and what is new LLVM makes a masked store, which takes longer than all else here.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry, Plot
from rigcast.kernels.hits.hit import NO_SHAPE, distance_of, middle
from rigcast.kernels.hits.out import Out
from rigcast.kernels.poses.scope import pose_of
from rigcast.kernels.shapes.facets import FIRST_IN_PATCHES, facet_at
from rigcast.kernels.shapes.solids import LARGEST, PLANE, SHEET, has_triangles
from rigcast.kernels.shapes.triangle import GRAZING
from rigcast.kernels.vectors import larger, lowest_bit, smaller, to_double

from .lanes import lane_bits
from .packet import (
    ALL_LANES,
    LANES,
    Facets,
    TileRays,
    Vectors,
    double_lanes,
    int_lanes,
    lanes,
    round_vectors,
    world_ray,
)
from .solids import closed_form_normals
from .staging import PacketOut


@wp.struct
class Places:
    """Where the rays of a packet hit; 0 where they hit nothing. Normals are in the world."""

    distance: lanes
    face: int_lanes
    normal_x: lanes
    normal_y: lanes
    normal_z: lanes


# these have no return type, which Warp 1.12 would take for that of a value
@wp.func_native("""
    auto& all = *wp::address(facets, 0);
#if defined(__CUDA_ARCH__)
    for (int i = 0; i < 16; ++i)
        if (numbers[i] == number) {
            all.height[i] = height;
            all.normal_x[i] = normal[0];
            all.normal_y[i] = normal[1];
            all.normal_z[i] = normal[2];
            all.face[i] = face;
        }
#else
    typedef int ints __attribute__((ext_vector_type(16)));
    typedef long long longs __attribute__((ext_vector_type(16)));
    typedef double doubles __attribute__((ext_vector_type(16)));
    ints hit;
    __builtin_memcpy(&hit, &numbers, sizeof(hit));
    const ints is_own = hit == number;
    const longs is_own_too = __builtin_convertvector(is_own, longs);
    const auto take = [&](auto& to, double value) {
        doubles values;
        __builtin_memcpy(&values, &to, sizeof(values));
        values = is_own_too ? (doubles)value : values;
        __builtin_memcpy(&to, &values, sizeof(values));
    };
    take(all.height, height);
    take(all.normal_x, normal[0]);
    take(all.normal_y, normal[1]);
    take(all.normal_z, normal[2]);
    ints faces;
    __builtin_memcpy(&faces, &all.face, sizeof(faces));
    faces = is_own ? (ints)face : faces;
    __builtin_memcpy(&all.face, &faces, sizeof(faces));
#endif
""")
def take_facet(  # type: ignore[no-untyped-def]
    facets: wp.array[Facets],
    numbers: int_lanes,
    number: int,
    height: wp.float64,
    normal: wp.vec3d,
    face: int,
):
    """The triangle by this number is that of all rays that hit it. height: V0 . n."""


FEW_FACETS = wp.constant(3)
"""Triangles up to which it is faster to take them one by one."""


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef int ints __attribute__((ext_vector_type(16)));
    typedef float floats __attribute__((ext_vector_type(16)));
    typedef double doubles __attribute__((ext_vector_type(16)));
    float x[2][16], y[2][16], z[3][16];
    int faces[16];
    ints is_upper, is_own;
    for (int i = 0; i < 16; ++i) {{
        const int number = numbers[i] < {int(FIRST_IN_PATCHES)} ? 0 : numbers[i] - {int(FIRST_IN_PATCHES)};
        const auto& plot = plots.data[number >> 6];
        const int row = (number >> 4 & 2) | (number >> 1 & 1), column = (number >> 2 & 6) | (number & 1);
        const int upper = number >> 2 & 1;
        const float *xs = &sides.data[plot.x + column], *ys = &sides.data[plot.y + row];
        const float* heights = &plot.z.data[row][column];
        x[0][i] = xs[0], x[1][i] = xs[1];
        y[0][i] = ys[0], y[1][i] = ys[1];
        z[0][i] = heights[0], z[1][i] = heights[upper ? 9 : 1], z[2][i] = heights[10];
        faces[i] = plot.face + 2 * (row * columns + column) + upper;
        is_upper[i] = -upper;
        is_own[i] = -(numbers[i] >= {int(FIRST_IN_PATCHES)});
    }}
    const auto read = [](const float* from) {{
        floats all;
        __builtin_memcpy(&all, from, sizeof(all));
        return __builtin_convertvector(all, doubles);
    }};
    typedef long long longs __attribute__((ext_vector_type(16)));
    const longs upper = __builtin_convertvector(is_upper, longs), own = __builtin_convertvector(is_own, longs);
    const doubles x0 = read(x[0]), dx = read(x[1]) - x0, y0 = read(y[0]), dy = read(y[1]) - y0;
    const doubles z0 = read(z[0]), third = read(z[1]), early = third - z0, late = read(z[2]) - third;
    const doubles a = upper ? late : early, b = upper ? early : late;
    const doubles normal_x = -a * dy, normal_y = -b * dx, normal_z = dx * dy;
    const doubles height = x0 * normal_x + y0 * normal_y + z0 * normal_z;
    auto& all = *wp::address(facets, 0);
    const auto take = [&](auto& to, const doubles values) {{
        doubles before;
        __builtin_memcpy(&before, &to, sizeof(before));
        before = own ? values : before;
        __builtin_memcpy(&to, &before, sizeof(before));
    }};
    take(all.height, height);
    take(all.normal_x, normal_x);
    take(all.normal_y, normal_y);
    take(all.normal_z, normal_z);
    for (int i = 0; i < 16; ++i) all.face[i] = is_own[i] ? faces[i] : all.face[i];
#endif
""")
def take_facets_of_patches(  # type: ignore[no-untyped-def]
    facets: wp.array[Facets], plots: wp.array[Plot], sides: wp.array[float], numbers: int_lanes, columns: int
):
    """What rigcast.kernels.shapes.facets.facet_of_patch finds, of all rays that hit triangles of patches."""


@wp.func_native("wp::address(places, k)->distance[i] = distance;")
def take_distance(places: wp.array[Places], k: int, i: int, distance: float):  # type: ignore[no-untyped-def]
    """That of ray i of packet k, alone, where Warp would copy all sixteen."""


@wp.func_native("""
    auto& own = *wp::address(places, k);
    const auto& normal = *wp::address(normals, 0);
#if defined(__CUDA_ARCH__)
    for (int i = 0; i < 16; ++i)
        if (shapes[i] == shape) {
            own.distance[i] = distance[i];
            own.face[i] = face[i];
            own.normal_x[i] = normal.x[i];
            own.normal_y[i] = normal.y[i];
            own.normal_z[i] = normal.z[i];
        }
#else
    typedef int ints __attribute__((ext_vector_type(16)));
    const auto bits = [](const auto& of) { ints all; __builtin_memcpy(&all, &of, sizeof(all)); return all; };
    const ints is_own = bits(shapes) == shape;
    const auto take = [&](auto& to, const ints from) {
        const ints all = bits(to) | (is_own & from);
        __builtin_memcpy(&to, &all, sizeof(all));
    };
    take(own.distance, bits(distance));
    take(own.face, bits(face));
    take(own.normal_x, bits(normal.x));
    take(own.normal_y, bits(normal.y));
    take(own.normal_z, bits(normal.z));
#endif
""")
def take_places(  # type: ignore[no-untyped-def]
    places: wp.array[Places],
    k: int,
    shapes: int_lanes,
    shape: int,
    distance: lanes,
    face: int_lanes,
    normals: wp.array[Vectors],
):
    """Those of the rays of packet k that hit this shape, of what was worked out for all of them."""


@wp.func
def scales_of(last: int, number: int_lanes, x: double_lanes, y: double_lanes, z: double_lanes) -> double_lanes:
    """1 / the lengths of the normals (x, y, z) of triangles by these numbers, as Facet has it. last: the largest."""
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
def place_triangles(
    g: Geometry, rays: wp.array[TileRays], places: wp.array[Places], k: int, which: int, shape: int
) -> None:
    """Where those rays of a packet hit which hit triangles of one shape."""
    slot = rays[0].first_slot + k
    x = rays[0].directions[slot].x
    y = rays[0].directions[slot].y
    z = rays[0].directions[slot].z
    hit = rays[0].best[slot].triangle
    facets = rays[0].facets
    last = int(0)
    todo = int(which)
    seen = int(0)
    while todo != 0:
        triangle = hit[lowest_bit(todo)]
        if triangle >= FIRST_IN_PATCHES and seen == FEW_FACETS:
            take_facets_of_patches(facets, g.plots, g.sides, hit, g.columns[rays[0].scope.first_shape + shape])
            last = triangle
            todo = todo & lanes_below(hit, FIRST_IN_PATCHES)
            continue
        seen += 1
        todo = todo & ~lanes_at(hit, triangle)
        last = wp.max(last, triangle)
        facet = facet_at(rays[0].geometry, rays[0].scope.first_shape + shape, triangle)
        height = wp.dot(to_double(facet.corner), facet.normal)
        take_facet(facets, hit, triangle, height, facet.normal, facet.face)
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
    grazing = double_lanes()  # below 0 where float64 must find the distance
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
    """Where those rays of a packet hit which hit one closed form, worked out for all of them at once."""
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
    """Those of a closed form, in its own frame, at these distances along the rays of a packet."""
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
    """Turn the vectors of a packet, in float64, and round them."""
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
    """Bit by bit, which of these is the number."""
    same = int_lanes()
    for i in range(LANES):
        same[i] = wp.where(numbers[i] == number, -1, 0)
    return lane_bits(same)


@wp.func
def lanes_below(numbers: int_lanes, number: int) -> int:
    """Bit by bit, which of these are below a number."""
    below = int_lanes()
    for i in range(LANES):
        below[i] = wp.where(numbers[i] < number, -1, 0)
    return lane_bits(below)


@wp.func
def place_packet(g: Geometry, rays: wp.array[TileRays], places: wp.array[Places], k: int) -> None:
    """Find where the rays of a packet hit, shape by shape."""
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
    """Stage what the rays of a packet hit, or read, as rigcast.kernels.hits.out has it."""
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
