"""Which triangles of a leaf a ray may pass inside: a loop over eight, as short code stays in the instruction cache.

Of an edge e = a - b, seen from the origin, s(a, b) = d . (e x (a + b)) of rigcast.kernels.shapes.triangle is
2 e . (a x d), as a x d and b x d differ by e x d. With two roundings of a, one each of d and e, two of the fused cross
product and three of the dot product, e . (a x d) is off by less than 9u |e|_1 |a|_1. It counts as 0 within 16u of that.
"""

import warp as wp

from rigcast.kernels.geometry import Patch, TriangleBlock
from rigcast.kernels.trees.nodes import FIRST_PATCH

from .native import on_cuda


# Coordinates of a block's triangle lie eight numbers apart; where those of a patch are, the first corner's, the third
# one's and the one's across, rigcast.kernels.shapes.patches says. Comparisons with NaN are false: what is not there is
# not passed.
@wp.func_native(
    on_cuda(f"""
    struct Point {{ float x, y, z; }};
    auto minus = [](Point a, Point b) -> Point {{ return {{a.x - b.x, a.y - b.y, a.z - b.z}}; }};
    auto norm = [](Point a) {{ return ::fabsf(a.x) + ::fabsf(a.y) + ::fabsf(a.z); }};
    auto seen = [&](Point p) -> Point {{
        return {{(p.x - origin[0]) - rest[0], (p.y - origin[1]) - rest[1], (p.z - origin[2]) - rest[2]}};
    }};
    auto side = [&](Point e, Point a) {{
        const float x = ::fmaf(a.y, direction[2], -(a.z * direction[1]));
        const float y = ::fmaf(a.z, direction[0], -(a.x * direction[2]));
        const float z = ::fmaf(a.x, direction[1], -(a.y * direction[0]));
        return ::fmaf(e.x, x, ::fmaf(e.y, y, e.z * z));
    }};
    const int patch = leaf - {int(FIRST_PATCH)};
    const float* number = patch >= 0 ? &patches.data[patch].x[0] : &blocks.data[leaf].x0[0];
    auto point = [&](int x, int y, int z) -> Point {{
        return {{__ldg(number + x), __ldg(number + y), __ldg(number + z)}};
    }};
    int passed = 0;
#pragma unroll 1
    for (int j = 0; j < 8; ++j) {{
        int x0 = j, y0 = j + 8, z0 = j + 16, x1 = j + 24, y1 = j + 32, z1 = j + 40;
        int x2 = j + 48, y2 = j + 56, z2 = j + 64;
        if (patch >= 0) {{
            const int row = j >> 1 & 1, upper = j >> 2;
            x0 = j & 1, y0 = 3 + row, z0 = 6 + 3 * row + x0;
            x1 = x0 + 1 - upper, y1 = y0 + upper, z1 = z0 + 1 + 2 * upper;
            x2 = x0 + 1, y2 = y0 + 1, z2 = z0 + 4;
        }}
        const Point a = point(x0, y0, z0), b = point(x1, y1, z1), c = point(x2, y2, z2);
        const Point v0 = seen(a), v1 = seen(b), v2 = seen(c), e0 = minus(a, b), e1 = minus(b, c), e2 = minus(c, a);
        const float s0 = side(e0, v0), r0 = rounding * norm(v0) * norm(e0);
        const float s1 = side(e1, v1), r1 = rounding * norm(v1) * norm(e1);
        const float s2 = side(e2, v2), r2 = rounding * norm(v2) * norm(e2);
        if ((s0 >= -r0 && s1 >= -r1 && s2 >= -r2) || (s0 <= r0 && s1 <= r1 && s2 <= r2)) passed |= 1 << j;
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
    rounding: float,
) -> int:
    """Bit by bit, triangles of a block or patch all of whose edges a ray from origin + rest may pass on one side."""
