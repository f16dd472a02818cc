"""Which triangles of a leaf a ray may pass inside: in loops, as short code stays in the instruction cache.

Of an edge e = a - b, seen from the origin, s(a, b) = d . (e x (a + b)) of rigcast.kernels.shapes.triangle is
2 e . (a x d), as a x d and b x d differ by e x d. With two roundings of a, one each of d and e, two of the fused cross
product and three of the dot product, e . (a x d) is off by less than 9u |e|_1 |a|_1. It counts as 0 within 16u of that.
"""

import warp as wp

from rigcast.kernels.geometry import Patch, TriangleBlock

from .native import on_cuda

_EDGES = """
    struct Point { float x, y, z; };
    struct Corner { Point at, turned; float rounded; };  // p, a x d and 16u |a|_1 with a = p - o
    auto norm = [](Point a) { return ::fabsf(a.x) + ::fabsf(a.y) + ::fabsf(a.z); };
    auto corner = [&](float x, float y, float z) -> Corner {
        const Point a = {(x - origin[0]) - rest[0], (y - origin[1]) - rest[1], (z - origin[2]) - rest[2]};
        const Point turned = {
            ::fmaf(a.y, direction[2], -(a.z * direction[1])),
            ::fmaf(a.z, direction[0], -(a.x * direction[2])),
            ::fmaf(a.x, direction[1], -(a.y * direction[0])),
        };
        return {{x, y, z}, turned, rounding * norm(a)};
    };
    struct Side { float low, high; };  // from where to where s / 2 may be
    auto side = [&](const Corner& a, const Corner& b) -> Side {
        const Point e = {a.at.x - b.at.x, a.at.y - b.at.y, a.at.z - b.at.z};
        const float s = ::fmaf(e.x, a.turned.x, ::fmaf(e.y, a.turned.y, e.z * a.turned.z));
        const float r = a.rounded * norm(e);
        return {s - r, s + r};
    };
    // comparisons with NaN are false: what is not there is not passed
    auto is_passed = [](Side a, Side b, Side c) {
        const bool is_left = a.high >= 0.0f && b.high >= 0.0f && c.high >= 0.0f;
        const bool is_right = a.low <= 0.0f && b.low <= 0.0f && c.low <= 0.0f;
        return is_left || is_right;
    };
    int passed = 0;
"""


@wp.func_native(
    on_cuda(f"""{_EDGES}
    const float* number = &blocks.data[k].x0[0];
#pragma unroll 1
    for (int j = 0; j < 8; ++j, ++number) {{
        const Corner a = corner(__ldg(number), __ldg(number + 8), __ldg(number + 16));
        const Corner b = corner(__ldg(number + 24), __ldg(number + 32), __ldg(number + 40));
        const Corner c = corner(__ldg(number + 48), __ldg(number + 56), __ldg(number + 64));
        if (is_passed(side(a, b), side(b, c), side(c, a))) passed |= 1 << j;
    }}
    return passed;
""")
)
def passed_in_block(  # type: ignore[empty-body]
    blocks: wp.array[TriangleBlock], k: int, origin: wp.vec3, rest: wp.vec3, direction: wp.vec3, rounding: float
) -> int:
    """Bit by bit, the triangles of block k all of whose edges a ray from origin + rest may pass on one side."""


@wp.func_native(
    on_cuda(f"""{_EDGES}
    const float* number = &patches.data[k].x[0];
    const float x0 = __ldg(number), x1 = __ldg(number + 1), x2 = __ldg(number + 2);
#pragma unroll 1
    for (int row = 0; row < 2; ++row) {{
        const float y0 = __ldg(number + 3 + row), y1 = __ldg(number + 4 + row);
        const float* z = number + 6 + 3 * row;
        const Corner a = corner(x0, y0, __ldg(z)), d = corner(x0, y1, __ldg(z + 3));
        const Corner b = corner(x1, y0, __ldg(z + 1)), e = corner(x1, y1, __ldg(z + 4));
        const Corner c = corner(x2, y0, __ldg(z + 2)), f = corner(x2, y1, __ldg(z + 5));
        const Side be = side(b, e), eb = {{-be.high, -be.low}}, ae = side(a, e), ea = {{-ae.high, -ae.low}};
        const Side bf = side(b, f), fb = {{-bf.high, -bf.low}};
        const int cells = (is_passed(side(a, b), be, ea) ? 1 : 0) | (is_passed(side(b, c), side(c, f), fb) ? 2 : 0)
            | (is_passed(ae, side(e, d), side(d, a)) ? 16 : 0) | (is_passed(bf, side(f, e), eb) ? 32 : 0);
        passed |= cells << 2 * row;
    }}
    return passed;
""")
)
def passed_in_patch(  # type: ignore[empty-body]
    patches: wp.array[Patch], k: int, origin: wp.vec3, rest: wp.vec3, direction: wp.vec3, rounding: float
) -> int:
    """The same of patch k, row by row of its cells."""
