"""Which triangles of a block a ray may pass inside, on the CPU."""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    #pragma clang fp contract(fast)
    typedef float floats __attribute__((ext_vector_type(8)));
    typedef float floats_anywhere __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool bools __attribute__((ext_vector_type(8)));
    const float x = direction[0], y = direction[1], z = direction[2];
    const float ax = __builtin_fabsf(x), ay = __builtin_fabsf(y), az = __builtin_fabsf(z);
    const float axy = ax > ay ? ax : ay, m = axy > az ? axy : az;
    const bool is_x = ax == m, is_y = !is_x && ay == m;
    const float px = is_x ? y : 0.0f, py = is_x ? -x : z, pz = is_x ? 0.0f : -y;
    const float qx = is_y ? y : -z, qy = is_y ? -x : 0.0f, qz = is_y ? 0.0f : x;
    const float ox = origin[0], oy = origin[1], oz = origin[2];
    const float pO = px * ox + (py * oy + (pz * oz + (px * rest[0] + (py * rest[1] + pz * rest[2]))));
    const float qO = qx * ox + (qy * oy + (qz * oz + (qx * rest[0] + (qy * rest[1] + qz * rest[2]))));
    const float off = 2.0f * m * margin, twice_squared = 2.0f * off * off;
    const float* const number = &blocks.data[k].x0[0];
    const auto row = [&](int i) -> floats { return *(const floats_anywhere*)(number + 8 * i); };
    const auto larger = [](floats a, floats b) { return a > b ? a : b; };
    const auto smaller = [](floats a, floats b) { return a < b ? a : b; };
    const auto size = [](floats a) { return __builtin_elementwise_abs(a); };
    const auto u_of = [&](floats x, floats y, floats z) { return z * pz + (y * py + (x * px - pO)); };
    const auto v_of = [&](floats x, floats y, floats z) { return z * qz + (y * qy + (x * qx - qO)); };
    const floats au = u_of(row(0), row(1), row(2)), av = v_of(row(0), row(1), row(2));
    const floats bu = u_of(row(3), row(4), row(5)), bv = v_of(row(3), row(4), row(5));
    const floats cu = u_of(row(6), row(7), row(8)), cv = v_of(row(6), row(7), row(8));
    const floats s0 = au * bv - av * bu, s1 = bu * cv - bv * cu, s2 = cu * av - cv * au;
    const floats sum = (size(au) + size(av)) + (size(cu) + size(cv)) + (size(bu) + size(bv));
    const floats zero = off * sum + twice_squared;
    const floats most = larger(s0, larger(s1, s2)), least = smaller(s0, smaller(s1, s2));
    const bools passed = __builtin_convertvector(smaller(most, -least) <= zero, bools);
    unsigned char bits;
    __builtin_memcpy(&bits, &passed, 1);
    return bits;
#endif
""")
def passed_in_block(
    blocks: wp.array[TriangleBlock], k: int, origin: wp.vec3, rest: wp.vec3, direction: wp.vec3, margin: float
) -> int:
    """Bit by bit, triangles of a block all of whose edges a ray from origin + rest may pass on one side."""
