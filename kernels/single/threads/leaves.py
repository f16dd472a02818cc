"""A ray against the triangles of a block or patch, by their edges.

Seen along a ray from O, a point P is at (p . (P - O), q . (P - O)), with p and q across the ray, and the ray meets a
triangle that has (0, 0) inside: where a_0 b_1 - a_1 b_0 has one sign for all its edges from a to b. The vectors
(0, z, -y), (-z, 0, x) and (y, -x, 0) are exactly perpendicular to d = (x, y, z); p and q are the two that contain its
largest component, of size m.

Error of the coordinates, u = eps / 2, |O| and |P| the largest coordinates of O and P:

- p . O: 3u m |O|;
- the sums for p . P - p . O: u m (|P| + 2|O|) and 2u m (|P| + |O|);
- the ray itself, as d is rounded and may be tilted (see rigcast.kernels.shapes.triangle): 1.5u m per metre, up to where
  it meets the triangle, at most 1.8 (|P| + |O|) away.

Together less than 10u m (|P| + |O|). If coordinates are off by e, the difference a_0 b_1 - a_1 b_0 is off by e times
the sum of its four coordinates, and by 2e^2. Its own three roundings, of products with coordinates up to
2m (|P| + |O|), are less than 2u m (|P| + |O|) times that sum. So a difference counts as 0 if it is within the error for
e = 16u m (|P| + |O|), which is 2m times the margin of boxes, and for the coordinates of all three corners. A larger
difference surely has the right sign; if all three do, the ray passes the edges on these sides in exact arithmetic.

Loops handle a few triangles at a time, because short code stays in the instruction cache.
"""

import warp as wp

from rigcast.kernels.geometry import Patch, TriangleBlock
from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.trees.nodes import FIRST_PATCH


# The coordinates of a block's triangle are eight numbers apart; the layout of a patch is in
# rigcast.kernels.shapes.patches. Absent triangles are NaN. Comparisons with NaN are false, so they are never passed.
@wp.func_native(
    on_cuda(f"""
    const float x = direction[0], y = direction[1], z = direction[2];
    const float m = ::fmaxf(::fabsf(x), ::fmaxf(::fabsf(y), ::fabsf(z)));
    const bool is_x = ::fabsf(x) == m, is_y = !is_x && ::fabsf(y) == m;
    const float px = is_x ? y : 0.0f, py = is_x ? -x : z, pz = is_x ? 0.0f : -y;
    const float qx = is_y ? y : -z, qy = is_y ? -x : 0.0f, qz = is_y ? 0.0f : x;
    auto dot = [](float ax, float ay, float az, const auto& b, float sum) {{
        return ::fmaf(ax, b[0], ::fmaf(ay, b[1], ::fmaf(az, b[2], sum)));
    }};
    const float pO = dot(px, py, pz, origin, dot(px, py, pz, rest, 0.0f));
    const float qO = dot(qx, qy, qz, origin, dot(qx, qy, qz, rest, 0.0f));
    const float off = 2.0f * m * margin, twice_squared = 2.0f * off * off;
    struct Place {{ float u, v; }};
    auto place = [&](float x, float y, float z) -> Place {{
        return {{
            ::fmaf(pz, z, ::fmaf(py, y, ::fmaf(px, x, -pO))),
            ::fmaf(qz, z, ::fmaf(qy, y, ::fmaf(qx, x, -qO))),
        }};
    }};
    auto passes = [&](Place a, Place b, Place c) {{
        const float s0 = ::fmaf(a.u, b.v, -(a.v * b.u));
        const float s1 = ::fmaf(b.u, c.v, -(b.v * c.u));
        const float s2 = ::fmaf(c.u, a.v, -(c.v * a.u));
        const float sum = (::fabsf(a.u) + ::fabsf(a.v)) + (::fabsf(c.u) + ::fabsf(c.v)) + (::fabsf(b.u) + ::fabsf(b.v));
        const float zero = ::fmaf(off, sum, twice_squared);
        const float most = ::fmaxf(s0, ::fmaxf(s1, s2)), least = ::fminf(s0, ::fminf(s1, s2));
        return (::fminf(most, -least) <= zero ? 1 : 0) + (::fmaxf(least, -most) > zero ? 256 : 0);
    }};
    int passed = 0;
    if (leaf < {int(FIRST_PATCH)}) {{
        const float* number = &blocks.data[leaf].x0[0];
#pragma unroll 1
        for (int j = 0; j < 8; ++j, ++number) {{
            const Place a = place(__ldg(number), __ldg(number + 8), __ldg(number + 16));
            const Place b = place(__ldg(number + 24), __ldg(number + 32), __ldg(number + 40));
            const Place c = place(__ldg(number + 48), __ldg(number + 56), __ldg(number + 64));
            passed |= passes(a, b, c) << j;
        }}
    }} else {{
        const float* number = &patches.data[leaf - {int(FIRST_PATCH)}].x[0];
#pragma unroll 1
        for (int row = 1; row >= 0; --row) {{
            const float *y = number + 3 + row, *z = number + 6 + 3 * row;
            auto corner = [&](int column, int above) {{
                return place(__ldg(number + column), __ldg(y + above), __ldg(z + 3 * above + column));
            }};
            Place b = corner(2, 0), c = corner(2, 1);
#pragma unroll 1
            for (int column = 1; column >= 0; --column) {{
                const Place a = corner(column, 0), d = corner(column, 1);
                passed = 2 * passed + passes(a, b, c) + 16 * passes(a, c, d);
                b = a, c = d;
            }}
        }}
    }}
    return passed;
""")
)
def passed_in_leaf(  # type: ignore[empty-body]
    blocks: wp.array[TriangleBlock],
    patches: wp.array[Patch],
    leaf: int,
    origin: wp.vec3,
    rest: wp.vec3,
    direction: wp.vec3,
    margin: float,
) -> int:
    """Bit masks of the triangles of a block or patch that a ray from origin + rest may pass inside.

    Bits 0 to 7: triangles all of whose edges it may pass on the same side. Bits 8 to 15: those whose edges it surely
    passes on the same side, so that it meets their inside.

    Args:
        leaf: number of the block, or of the patch from FIRST_PATCH on.
        margin: 8u (|P| + |O|), by which boxes are widened, too.
    """
