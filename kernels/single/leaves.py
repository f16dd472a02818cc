"""A ray against the eight triangles of a block at once, by their edges; most blocks have none that it may pass inside.

The method and its derivation are in rigcast.kernels.single.threads.leaves, for CUDA. Here products are fused with sums
only if the CPU can do so, which leaves more roundings. In that module's terms they are:

- p . O: 6u m |O|, the roundings of two products and two sums, as two of the three components of p and q are not 0;
- p . P - p . O: 5u m |P| + 4u m |O|;
- direction: 2.7u m (|P| + |O|).

Together less than 13u m (|P| + |O|). With 2u m for the three roundings of an edge's difference, this is less than the
16u m (|P| + |O|) that the code allows for.
"""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock

from .native import on_cpu


# Absent triangles are NaN. Comparisons with NaN are false, so they are never passed.
@wp.func_native(
    on_cpu("""
    const float x = direction[0], y = direction[1], z = direction[2];
    const float m = larger(__builtin_fabsf(x), larger(__builtin_fabsf(y), __builtin_fabsf(z)));
    const bool is_x = __builtin_fabsf(x) == m, is_y = !is_x && __builtin_fabsf(y) == m;
    const float px = is_x ? y : 0.0f, py = is_x ? -x : z, pz = is_x ? 0.0f : -y;
    const float qx = is_y ? y : -z, qy = is_y ? -x : 0.0f, qz = is_y ? 0.0f : x;
    const auto dot = [](float ax, float ay, float az, const auto& b) { return ax * b[0] + (ay * b[1] + az * b[2]); };
    const float pO = dot(px, py, pz, origin) + dot(px, py, pz, rest);
    const float qO = dot(qx, qy, qz, origin) + dot(qx, qy, qz, rest);
    const float off = 2.0f * m * margin, twice_squared = 2.0f * off * off;
    const float* const numbers = &blocks.data[k].x0.c[0];
    const auto row = [&](int i) -> floats { return *(const floats_anywhere*)(numbers + 8 * i); };
    const auto u_of = [&](int i) { return row(i + 2) * pz + (row(i + 1) * py + (row(i) * px - pO)); };
    const auto v_of = [&](int i) { return row(i + 2) * qz + (row(i + 1) * qy + (row(i) * qx - qO)); };
    const floats au = u_of(0), av = v_of(0), bu = u_of(3), bv = v_of(3), cu = u_of(6), cv = v_of(6);
    const floats s0 = au * bv - av * bu, s1 = bu * cv - bv * cu, s2 = cu * av - cv * au;
    const auto size = [](floats u, floats v) { return __builtin_elementwise_abs(u) + __builtin_elementwise_abs(v); };
    const floats zero = off * (size(au, av) + size(bu, bv) + size(cu, cv)) + twice_squared;
    const floats most = larger(s0, larger(s1, s2)), least = smaller(s0, smaller(s1, s2));
    return bits_of(smaller(most, -least) <= zero) | bits_of(larger(least, -most) > zero) << 8;
""")
)
def passed_in_block(  # type: ignore[empty-body]
    blocks: wp.array[TriangleBlock], k: int, origin: wp.vec3, rest: wp.vec3, direction: wp.vec3, margin: float
) -> int:
    """Bit masks of the triangles of block k that a ray from origin + rest may pass inside.

    Bits 0 to 7: triangles all of whose edges it may pass on the same side. Bits 8 to 15: those whose edges it surely
    passes on the same side, so that it meets their inside.

    Args:
        margin: 8u (|P| + |O|), by which boxes are widened, too.
    """
