"""The hits of a tile on their way out: staged in the cache of a CPU, and written from there line by line.

A hit that is written by itself goes to parts of four cache lines, which come from memory for that. Of a lidar's rows,
and of an image's, a tile has rows of 16 rays that follow each other. Their hits fill whole lines, which can be written
without being read, past the cache: streamed.
"""

import warp as wp

from rigcast.kernels.out import Out

from .packet import LANES, TILE, TileRays, int_lanes

FLOATS_PER_TILE = wp.constant(6 * TILE)
"""Of 4 bytes, for what is in Out."""


@wp.func
def staged_in(scratch: wp.array[float]) -> Out:
    """The hits of one tile, those of packet k from LANES k on, in FLOATS_PER_TILE."""
    staged = Out()
    staged.distance = wp.array(ptr=scratch.ptr, shape=(TILE,), dtype=float)
    staged.shape = wp.array(ptr=scratch.ptr + wp.uint64(4 * TILE), shape=(TILE,), dtype=int)
    staged.face = wp.array(ptr=scratch.ptr + wp.uint64(8 * TILE), shape=(TILE,), dtype=int)
    staged.normal = wp.array(ptr=scratch.ptr + wp.uint64(12 * TILE), shape=(TILE,), dtype=wp.vec3)
    return staged


# these have no return type, which Warp 1.12 would take for that of a value
@wp.func_native(f"""
    for (int i = 0; i < {TILE}; ++i) staged.distance.data[i] = distance;
    for (int i = 0; i < {TILE}; ++i) staged.shape.data[i] = -1;
    for (int i = 0; i < {TILE}; ++i) staged.face.data[i] = -1;
    for (int i = 0; i < 3 * {TILE}; ++i) (&staged.normal.data[0][0])[i] = 0.0f;
""")
def stage_misses(staged: Out, distance: float):  # type: ignore[no-untyped-def]
    """Those of a whole tile."""


@wp.func_native("""
    const auto write = [&](char* to, const char* from, int size) {
        for (int part = 0; part < 4; ++part, from += step * size)
            for (int i = 0; i < 4 * size; i += 16, to += 16) {
#if defined(__CUDA_ARCH__)
                memcpy(to, from + i, 16);
#else
                typedef float floats __attribute__((ext_vector_type(4)));
                typedef float floats_anywhere __attribute__((ext_vector_type(4), aligned(4)));
                const floats values = *(const floats_anywhere*)(from + i);
                if (is_streamed && (size_t)to % 16 == 0) __builtin_nontemporal_store(values, (floats*)to);
                else *(floats_anywhere*)to = values;
#endif
            }
    };
    write((char*)&out.distance.data[ray], (const char*)&staged.distance.data[at], 4);
    write((char*)&out.shape.data[ray], (const char*)&staged.shape.data[at], 4);
    write((char*)&out.face.data[ray], (const char*)&staged.face.data[at], 4);
    write((char*)&out.normal.data[ray], (const char*)&staged.normal.data[at], 12);
""")
def write_row(out: Out, ray: int, staged: Out, at: int, step: int, is_streamed: bool):  # type: ignore[no-untyped-def]
    """The hits of 16 rays from this one on: of four at `at`, four at `at` + step, and so on."""


@wp.func_native("""
#if defined(__x86_64__) && !defined(__CUDA_ARCH__)
    __builtin_ia32_sfence();
#endif
""")
def end_stream():  # type: ignore[no-untyped-def]
    """What was streamed is there before what is written after this: a CPU does not order it otherwise."""


@wp.func_native("""
    for (int lane = 0; lane < 16; ++lane) {
        const int ray = numbers[lane];
        if (ray < 0) continue;
        out.distance.data[first_ray + ray] = staged.distance.data[at + lane];
        out.shape.data[first_ray + ray] = staged.shape.data[at + lane];
        out.face.data[first_ray + ray] = staged.face.data[at + lane];
        out.normal.data[first_ray + ray] = staged.normal.data[at + lane];
    }
""")
def write_one_by_one(out: Out, first_ray: int, numbers: int_lanes, staged: Out, at: int):  # type: ignore[no-untyped-def]
    """The hits of 16 rays by these numbers, -1 for none, from `at` on. Native: Warp asks of every index where it begins
    to count."""


@wp.func
def write_part(out: Out, rays: wp.array[TileRays], staged: Out, k: int, is_streamed: bool) -> None:
    """Write what row k of a tile hits, or its packet k where it has no rows."""
    across = rays[0].tile.across
    if across > 0:
        at = k / across * across * LANES + k % across * 4
        write_row(out, rays[0].first_ray + rays[0].tile.rows[k], staged, at, 4 * across, is_streamed)
    else:
        numbers = rays[0].packets[rays[0].first_packet + k].ray
        write_one_by_one(out, rays[0].first_ray, numbers, staged, k * LANES)
