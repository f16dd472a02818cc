"""The hits of a tile on their way out: staged in the cache of a CPU, and written from there line by line.

A hit that is written by itself goes to parts of four cache lines, which come from memory for that. Of a lidar's rows,
and of an image's, a tile has rows of 16 rays that follow each other. Their hits fill whole lines, which can be written
without being read, past the cache: streamed.
"""

import warp as wp

from rigcast.kernels.hits.out import Out

from .packet import LANES, PACKETS, TileRays, int_lanes, lanes


@wp.struct
class PacketOut:
    """What the rays of a packet hit, as in HitArrays, coordinate by coordinate."""

    distance: lanes
    shape: int_lanes
    face: int_lanes
    normal_x: lanes
    normal_y: lanes
    normal_z: lanes


# these have no return type, which Warp 1.12 would take for that of a value
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
    """Those of a whole tile."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int i = 0; i < 16; ++i) {
        const int from = at + i / 4 * step + i % 4;
        const auto& hits = staged.data[from / 16];
        const int lane = from % 16;
        out.distance.data[ray + i] = hits.distance[lane];
        out.shape.data[ray + i] = hits.shape[lane];
        out.face.data[ray + i] = hits.face[lane];
        out.normal.data[ray + i] = wp::vec3(hits.normal_x[lane], hits.normal_y[lane], hits.normal_z[lane]);
    }
#else
    typedef float floats __attribute__((ext_vector_type(4)));
    typedef float floats_anywhere __attribute__((ext_vector_type(4), aligned(4)));
    const auto four = [&](const auto& of, int part) {
        return *(const floats_anywhere*)((const float*)&of + (at + part * step) % 16);
    };
    const auto hits_of = [&](int part) -> const auto& { return staged.data[(at + part * step) / 16]; };
    const auto write = [&](auto store) {  // line by line: few are open at once
        for (int part = 0; part < 4; ++part)
            store((float*)&out.distance.data[ray] + 4 * part, four(hits_of(part).distance, part));
        for (int part = 0; part < 4; ++part)
            store((float*)&out.shape.data[ray] + 4 * part, four(hits_of(part).shape, part));
        for (int part = 0; part < 4; ++part)
            store((float*)&out.face.data[ray] + 4 * part, four(hits_of(part).face, part));
        for (int part = 0; part < 4; ++part) {
            const auto& hits = hits_of(part);
            const floats x = four(hits.normal_x, part), y = four(hits.normal_y, part), z = four(hits.normal_z, part);
            const floats xy01 = __builtin_shufflevector(x, y, 0, 4, 1, 5);
            const floats yz1 = __builtin_shufflevector(y, z, 1, 5, 1, 5);
            const floats xy23 = __builtin_shufflevector(x, y, 2, 6, 3, 7);
            float* normal = (float*)&out.normal.data[ray] + 12 * part;
            store(normal, __builtin_shufflevector(xy01, z, 0, 1, 4, 2));
            store(normal + 4, __builtin_shufflevector(yz1, xy23, 0, 1, 4, 5));
            store(normal + 8, __builtin_shufflevector(z, xy23, 2, 6, 7, 3));
        }
    };
    const size_t ends = (size_t)&out.distance.data[ray] | (size_t)&out.shape.data[ray] | (size_t)&out.face.data[ray]
        | (size_t)&out.normal.data[ray];
    if (is_streamed && ends % 16 == 0)
        write([](float* to, floats values) { __builtin_nontemporal_store(values, (floats*)to); });
    else
        write([](float* to, floats values) { *(floats_anywhere*)to = values; });
#endif
""")
def write_row(out: Out, ray: int, staged: wp.array[PacketOut], at: int, step: int, is_streamed: bool):  # type: ignore[no-untyped-def]
    """The hits of 16 rays from this one on: of four at `at`, four at `at` + step, and so on, of a tile's."""


@wp.func_native("""
#if defined(__x86_64__) && !defined(__CUDA_ARCH__)
    __builtin_ia32_sfence();
#endif
""")
def end_stream():  # type: ignore[no-untyped-def]
    """What was streamed is there before what is written after this: a CPU does not order it otherwise."""


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
    """The hits of packet k, of the rays by these numbers, -1 for none. Native: Warp asks of every index where it begins
    to count."""


@wp.func
def write_part(out: Out, rays: wp.array[TileRays], staged: wp.array[PacketOut], k: int, is_streamed: bool) -> None:
    """Write what row k of a tile hits, or its packet k where it has no rows."""
    across = rays[0].tile.across
    if across > 0:
        at = k / across * across * LANES + k % across * 4
        write_row(out, rays[0].first_ray + rays[0].tile.rows[k], staged, at, 4 * across, is_streamed)
    else:
        numbers = rays[0].packets[rays[0].first_packet + k].ray
        write_one_by_one(out, rays[0].first_ray, numbers, staged, k)
