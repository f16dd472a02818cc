"""The surface of a height field: no triangle of it is stored, for each is made where rays come near it.

      row 2 +---+---+     A patch is two by two cells, eight triangles: number j is that of the cell in row j / 2 % 2
            |6 /|7 /|     and column j % 2 which lies below its diagonal or, from 4 on, above it. A patch is one cache
            | /2| /3|     line, of which a block of stored triangles takes seven.
      row 1 +---+---+
            |4 /|5 /|     Corners are those of the cell of lower row and column, of higher ones, and between these the
            | /0| /1|     third corner below the diagonal; above it the third one comes last.
      row 0 +---+---+

The normal of a triangle that rises by a per metre along x and by b along y is (-a, -b, 1) / sqrt(1 + a^2 + b^2). In
float32 each of a and b has the rounding of two differences and a quotient, and the product with the root one more: the
normal is off by 4u, u = eps / 2, apart from its length, which t = w . n / (d . n) does not depend on. Where a or b
overflows or a side is 0 m long, it is 0 or NaN, which leaves the distance to float64.
"""

import warp as wp

from .geometry import Patch, TriangleBlock

_CORNERS = {
    # which of a patch's 16 numbers: x of its columns begins at 0, y of its rows at 3, z row by row at 6, 9 and 12
    "x0": (0, 1, 0, 1, 0, 1, 0, 1),
    "y0": (3, 3, 4, 4, 3, 3, 4, 4),
    "z0": (6, 7, 9, 10, 6, 7, 9, 10),
    "x1": (1, 2, 1, 2, 1, 2, 1, 2),
    "y1": (3, 3, 4, 4, 4, 4, 5, 5),
    "z1": (7, 8, 10, 11, 10, 11, 13, 14),
    "x2": (1, 2, 1, 2, 0, 1, 0, 1),
    "y2": (4, 4, 5, 5, 4, 4, 5, 5),
    "z2": (10, 11, 13, 14, 9, 10, 12, 13),
    # from where it rises along x to corner 1, and along y to corner 2
    "zx": (6, 7, 9, 10, 9, 10, 12, 13),
    "zy": (7, 8, 10, 11, 6, 7, 9, 10),
}
_PARTS = [f"{axis}{corner}" for corner in range(3) for axis in "xyz"]
_ORDERS = ", ".join("{" + ", ".join(map(str, order)) + "}" for order in _CORNERS.values())
_TAKEN = "\n".join(
    f"floats {name} = __builtin_shufflevector(a, b, {', '.join(map(str, order))});" for name, order in _CORNERS.items()
)
_GIVEN = "\n".join(
    f"__builtin_memcpy(&to->{name}, &{name}, sizeof(floats));" for name in [*_PARTS, *(f"normal_{a}" for a in "xyz")]
)


# without a return type, as Warp 1.12 knows none but numbers there
@wp.func_native(f"""
    auto* from = wp::address(patches, k);
    auto* to = wp::address(block, 0);
#if defined(__CUDA_ARCH__)
    const char order[11][8] = {{{_ORDERS}}};
    const float* numbers = &from->x[0];
    for (int j = 0; j < 8; ++j) {{
        float v[11];
        for (int i = 0; i < 11; ++i) v[i] = numbers[order[i][j]];
        const float no_x = v[3] - v[3], no_y = v[7] - v[7];
        v[0] += no_x;
        v[6] += no_x;
        v[1] += no_y;
        v[4] += no_y;
        const float rise_x = (v[9] - v[5]) / (v[3] - v[0]), rise_y = (v[10] - v[8]) / (v[7] - v[1]);
        const float root = 1.0f / ::sqrt(1.0f + rise_x * rise_x + rise_y * rise_y);
        float* const parts[12] = {{{", ".join(f"&to->{name}[j]" for name in _PARTS)},
            &to->normal_x[j], &to->normal_y[j], &to->normal_z[j]}};
        const float normal[3] = {{rise_x * root, rise_y * root, root}};
        for (int i = 0; i < 12; ++i) *parts[i] = i < 9 ? v[i] : normal[i - 9];
    }}
#else
    typedef float floats __attribute__((ext_vector_type(8)));
    floats a, b;
    __builtin_memcpy(&a, &from->x, sizeof(a));
    __builtin_memcpy(&b, &from->z.data[0][2], sizeof(b));
    {_TAKEN}
    const floats no_x = x1 - x1, no_y = y2 - y2;
    x0 += no_x;
    x2 += no_x;
    y0 += no_y;
    y1 += no_y;
    const floats rise_x = (zx - z1) / (x1 - x0), rise_y = (zy - z2) / (y2 - y0);
    floats root = 1.0f + rise_x * rise_x + rise_y * rise_y;
    for (int j = 0; j < 8; ++j) root[j] = __builtin_sqrtf(root[j]);
    const floats normal_z = 1.0f / root, normal_x = rise_x * normal_z, normal_y = rise_y * normal_z;
    {_GIVEN}
#endif
""")
def compose(patches: wp.array[Patch], k: int, block: wp.array[TriangleBlock]):  # type: ignore[no-untyped-def]
    """Make a block of the triangles of patch k, without their faces; what is not there has x or y of NaN."""
