"""Masked writes of values computed for all lanes of a packet: only the lanes that hit a shape or triangle take them.

Per-shape results are merged by a bitwise `or` into memory that begins as 0. A choice between the old and the new value
would become a masked store in LLVM, which takes longer than everything else here.
"""

import warp as wp

from rigcast.kernels.packets.packet import Facets, Vectors, int_lanes, lanes


@wp.struct
class Places:
    """Distance [m], face and world normal of each hit of a packet; 0 in lanes that hit nothing."""

    distance: lanes
    face: int_lanes
    normal_x: lanes
    normal_y: lanes
    normal_z: lanes


# no return type here: Warp 1.12 takes `-> None` for the type of a value
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
    """Write plane and face of one triangle to all lanes whose number is `number`. height: V0 . n."""


@wp.func_native("wp::address(places, k)->distance[i] = distance;")
def take_distance(places: wp.array[Places], k: int, i: int, distance: float):  # type: ignore[no-untyped-def]
    """Write the distance of lane i of packet k alone; Warp would copy all sixteen."""


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
    """Write distance, face and normal to those lanes of packet k that hit this shape."""
