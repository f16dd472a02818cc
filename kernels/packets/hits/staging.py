"""Output of a tile's hits: staged in the CPU's cache, then written one whole cache line at a time.

Writing one hit touches four cache lines in part, and the CPU must read each from memory first. But a tile covers rows
of 16 consecutive rays of a lidar's or an image's rows. The hits of such a row fill whole cache lines, which can be
streamed: written past the cache without being read.
"""

import warp as wp

from rigcast.kernels.hits.out import Out
from rigcast.kernels.packets.packet import LANES, PACKETS, TileRays, int_lanes, lanes


@wp.struct
class PacketOut:
    """The hits of a packet with the fields of HitArrays, as a structure of arrays."""

    distance: lanes
    shape: int_lanes
    face: int_lanes
    normal_x: lanes
    normal_y: lanes
    normal_z: lanes


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native(f"""
    for (int k = 0; k < {PACKETS}; ++k) {{
        auto& hits = staged.data[k];
        for (int i = 0; i < {LANES}; ++i) {{
            hits.distance[i] = distance;
            hits.shape[i] = -1;
            hits.face[i] = -1;
            hits.normal_x[i] = 0.0f;
            hits.normal_y[i] = 0.0f;
            hits.normal_z[i] = 0.0f;
        }}
    }}
""")
def stage_misses(staged: wp.array[PacketOut], distance: float):  # type: ignore[no-untyped-def]
    """Stage a miss at this distance (+inf or NaN) for every lane of a tile."""


def _interleaved(begin: int) -> tuple[str, str]:
    """C++ shuffle masks for numbers begin..begin+15 of 16 interleaved vectors x0 y0 z0 x1 ...

    The first mask picks from x and y (-1 where z belongs), the second adds z to the result.
    """
    numbers = [divmod(begin + i, 3) for i in range(16)]
    of_xy = ", ".join(str(ray + 16 * axis if axis < 2 else -1) for ray, axis in numbers)
    with_z = ", ".join(str(i if axis < 2 else 16 + ray) for i, (ray, axis) in enumerate(numbers))
    return of_xy, with_z


_VECTORS = "".join(
    f"store(to + {begin}, __builtin_shufflevector(__builtin_shufflevector(x, y, {of_xy}), z, {with_z}));"
    for begin in (0, 16, 32)
    for of_xy, with_z in [_interleaved(begin)]
)

_LINES = f"""
    typedef float floats __attribute__((ext_vector_type(4)));
    typedef float floats_anywhere __attribute__((ext_vector_type(4), aligned(4)));
    typedef float line __attribute__((ext_vector_type(16)));
    typedef float line_anywhere __attribute__((ext_vector_type(16), aligned(4)));
    const auto packet_at = [&](unsigned part) {{ return (at + part * step) / 16u; }};
    const auto four = [&](const auto& of, unsigned part) {{
        return *(const floats_anywhere*)((const float*)&of + (at + part * step) % 16u);
    }};
    const auto hits_of = [&](unsigned part) -> const auto& {{ return staged.data[packet_at(part)]; }};
    const auto joined = [](floats a, floats b, floats c, floats d) {{
        const auto low = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
        const auto high = __builtin_shufflevector(c, d, 0, 1, 2, 3, 4, 5, 6, 7);
        return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    }};
    const auto line_of = [&](auto part_of) {{ return joined(part_of(0), part_of(1), part_of(2), part_of(3)); }};
    const auto store_vectors = [](auto store, float* to, line x, line y, line z) {{ {_VECTORS} }};
    const auto write_lines = [&](auto write, size_t ends) {{  // line by line: few are open at once
        if (is_streamed && ends % sizeof(line) == 0)
            write([](float* to, line values) {{ __builtin_nontemporal_store(values, (line*)to); }});
        else
            write([](float* to, line values) {{ *(line_anywhere*)to = values; }});
    }};
"""
"""C++ for the CPU: gathers a line of 16 rays from four parts of four lanes, and stores it.

`write_lines(write, ends)` streams past the cache if `is_streamed` and all destinations begin on a cache line. `ends` is
the bitwise or of the destination addresses.
"""


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    for (int i = 0; i < 16; ++i) {{
        const int from = at + i / 4 * step + i % 4;
        const auto& hits = staged.data[from / 16];
        const int lane = from % 16;
        out.distance.data[ray + i] = hits.distance[lane];
        out.shape.data[ray + i] = hits.shape[lane];
        out.face.data[ray + i] = hits.face[lane];
        out.normal.data[ray + i] = wp::vec3(hits.normal_x[lane], hits.normal_y[lane], hits.normal_z[lane]);
    }}
#else
    {_LINES}
    float *const distance = &out.distance.data[ray], *const normal = (float*)&out.normal.data[ray];
    float *const shape = (float*)&out.shape.data[ray], *const face = (float*)&out.face.data[ray];
    const auto write = [&](auto store) {{
        store(distance, line_of([&](int part) {{ return four(hits_of(part).distance, part); }}));
        store(shape, line_of([&](int part) {{ return four(hits_of(part).shape, part); }}));
        store(face, line_of([&](int part) {{ return four(hits_of(part).face, part); }}));
        const line x = line_of([&](int part) {{ return four(hits_of(part).normal_x, part); }});
        const line y = line_of([&](int part) {{ return four(hits_of(part).normal_y, part); }});
        const line z = line_of([&](int part) {{ return four(hits_of(part).normal_z, part); }});
        store_vectors(store, normal, x, y, z);
    }};
    write_lines(write, (size_t)distance | (size_t)shape | (size_t)face | (size_t)normal);
#endif
""")
def write_row(out: Out, ray: int, staged: wp.array[PacketOut], at: int, step: int, is_streamed: bool):  # type: ignore[no-untyped-def]
    """Write the hits of rays `ray` to `ray` + 15, staged in fours at lanes at, at + step, ... of the tile."""


_FIELDS_OF_ONE = """
    const auto& tile = rays.data[0];
    const auto& fields = tile.fields;
    const auto write_fields_of = [&](int ray, int k, int lane) {
        const auto& packet = tile.packets.data[tile.first_packet + k];
        const float distance = staged.data[k].distance[lane];
        const int shape = staged.data[k].shape[lane];
        const bool is_finite = distance - distance == 0.0f;
        const double t = is_finite ? distance : NAN, z = t * packet.z[lane];
        if (fields.points.shape[0] > 0)
            fields.points.data[ray] = wp::vec3((float)(tile.start[0] + t * packet.x[lane]),
                                               (float)(tile.start[1] + t * packet.y[lane]), (float)(tile.start[2] + z));
        if (fields.depth.shape[0] > 0) fields.depth.data[ray] = is_finite ? (float)z : distance;
        if (fields.body_id.shape[0] > 0) fields.body_id.data[ray] = shape < 0 ? -1 : fields.body_of_shape.data[shape];
    };
"""
"""C++: rigcast.kernels.hits.fields.write_fields for one ray, in a lane of packet k."""


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    {_FIELDS_OF_ONE}
    for (int i = 0; i < 16; ++i) {{
        const int from = at + i / 4 * step + i % 4;
        write_fields_of(ray + i, from / 16, from % 16);
    }}
#else
    {_LINES}
    typedef int ints __attribute__((ext_vector_type(4)));
    typedef double doubles __attribute__((ext_vector_type(4)));
    typedef double doubles_anywhere __attribute__((ext_vector_type(4), aligned(8)));
    const auto& tile = rays.data[0];
    const auto& fields = tile.fields;
    const auto packet_of = [&](int part) -> const auto& {{
        return tile.packets.data[tile.first_packet + packet_at(part)];
    }};
    const auto along = [&](const auto& direction, floats t, int part) {{
        const double* from = (const double*)&direction + (at + part * step) % 16u;
        return __builtin_convertvector(t, doubles) * *(const doubles_anywhere*)from;
    }};
    const auto rounded = [](doubles values) {{ return __builtin_convertvector(values, floats); }};
    const auto distance_of = [&](int part) {{ return four(hits_of(part).distance, part); }};
    const auto finite_of = [&](int part) {{
        const floats distance = distance_of(part);
        return distance - distance == 0.0f ? distance : (floats)NAN;
    }};
    const auto write_points = [&](auto store) {{
        const auto from = [&](double start, const auto& direction, int part) {{
            return rounded(start + along(direction, finite_of(part), part));
        }};
        const line x = line_of([&](int part) {{ return from(tile.start[0], packet_of(part).x, part); }});
        const line y = line_of([&](int part) {{ return from(tile.start[1], packet_of(part).y, part); }});
        const line z = line_of([&](int part) {{ return from(tile.start[2], packet_of(part).z, part); }});
        store_vectors(store, (float*)&fields.points.data[ray], x, y, z);
    }};
    const auto write_depth = [&](auto store) {{
        store((float*)&fields.depth.data[ray], line_of([&](int part) {{
            const floats distance = distance_of(part), z = rounded(along(packet_of(part).z, distance, part));
            return distance - distance == 0.0f ? z : distance;
        }}));
    }};
    const auto write_bodies = [&](auto store) {{
        store((float*)&fields.body_id.data[ray], line_of([&](int part) {{
            const int* shape = (const int*)&hits_of(part).shape + (at + part * step) % 16u;
            ints body;
            for (int i = 0; i < 4; ++i) body[i] = shape[i] < 0 ? -1 : fields.body_of_shape.data[shape[i]];
            return (floats)body;
        }}));
    }};
    if (fields.points.shape[0] > 0) write_lines(write_points, (size_t)&fields.points.data[ray]);
    if (fields.depth.shape[0] > 0) write_lines(write_depth, (size_t)&fields.depth.data[ray]);
    if (fields.body_id.shape[0] > 0) write_lines(write_bodies, (size_t)&fields.body_id.data[ray]);
#endif
""")
def write_fields_of_row(  # type: ignore[no-untyped-def]
    rays: wp.array[TileRays], ray: int, staged: wp.array[PacketOut], at: int, step: int, is_streamed: bool
):
    """Write the derived fields (points, depth, body ids) of rays `ray` to `ray` + 15; arguments as of `write_row`."""


@wp.func_native("""
#if defined(__x86_64__) && !defined(__CUDA_ARCH__)
    __builtin_ia32_sfence();
#endif
""")
def end_stream():  # type: ignore[no-untyped-def]
    """Store fence: streamed stores become visible before any later store, which a CPU does not guarantee by itself."""


@wp.func_native("""
    const auto& hits = staged.data[k];
    for (int i = 0; i < 16; ++i) {
        const int ray = first_ray + numbers[i];
        if (numbers[i] < 0) continue;
        out.distance.data[ray] = hits.distance[i];
        out.shape.data[ray] = hits.shape[i];
        out.face.data[ray] = hits.face[i];
        out.normal.data[ray] = wp::vec3(hits.normal_x[i], hits.normal_y[i], hits.normal_z[i]);
    }
""")
def write_one_by_one(out: Out, first_ray: int, numbers: int_lanes, staged: wp.array[PacketOut], k: int):  # type: ignore[no-untyped-def]
    """Write the hits of packet k. numbers: ray of each lane, -1 for none. Native: Warp checks every index for < 0."""


@wp.func_native(f"""
    {_FIELDS_OF_ONE}
    if (fields.points.shape[0] + fields.depth.shape[0] + fields.body_id.shape[0] > 0)
        for (int i = 0; i < 16; ++i)
            if (numbers[i] >= 0) write_fields_of(tile.first_ray + numbers[i], k, i);
""")
def write_fields_one_by_one(  # type: ignore[no-untyped-def]
    rays: wp.array[TileRays], numbers: int_lanes, staged: wp.array[PacketOut], k: int
):
    """Write the derived fields of packet k; arguments as of `write_one_by_one`."""


@wp.func
def write_part(out: Out, rays: wp.array[TileRays], staged: wp.array[PacketOut], k: int, is_streamed: bool) -> None:
    """Write hits and derived fields of row k of a tile, or of its packet k if the tile has no rows."""
    across = rays[0].tile.across
    if across > 0:
        at = k * LANES
        if across == 4:
            at = (k & ~3) * LANES + (k & 3) * 4
        ray = rays[0].first_ray + rays[0].tile.rows[k]
        write_row(out, ray, staged, at, 4 * across, is_streamed)
        write_fields_of_row(rays, ray, staged, at, 4 * across, is_streamed)
    else:
        numbers = rays[0].packets[rays[0].first_packet + k].ray
        write_one_by_one(out, rays[0].first_ray, numbers, staged, k)
        write_fields_one_by_one(rays, numbers, staged, k)
