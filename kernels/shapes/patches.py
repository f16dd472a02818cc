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

from rigcast.kernels.geometry import Patch, TriangleBlock

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
_GIVEN = [name for name in _CORNERS if name[1].isdigit()] + ["normal_x", "normal_y", "normal_z"]
_ON_CPU = "".join(
    f"floats {name} = __builtin_shufflevector(a, b, {', '.join(map(str, order))});" for name, order in _CORNERS.items()
)
_ON_CUDA = "".join(
    f"const char {name}_of[8] = {{{', '.join(map(str, order))}}}; float {name} = numbers[{name}_of[j]];"
    for name, order in _CORNERS.items()
)
_STORED = "".join(f"__builtin_memcpy(&to->{name}, &{name}, sizeof({name}));" for name in _GIVEN)
_STORED_ON_CUDA = "".join(f"to->{name}[j] = {name};" for name in _GIVEN)

# of one float on CUDA, and of vectors of eight
_WORKED_OUT = """
    x0 += x1 - x1;  // NaN where there is no such triangle, else 0
    x2 += x1 - x1;
    y0 += y2 - y2;
    y1 += y2 - y2;
    auto rise_x = (zx - z1) / (x1 - x0), rise_y = (zy - z2) / (y2 - y0);
    auto square = 1.0f + rise_x * rise_x + rise_y * rise_y;
"""


# without a return type, as Warp 1.12 knows none but numbers there
@wp.func_native(f"""
    auto* from = wp::address(patches, k);
    auto* to = wp::address(block, 0);
#if defined(__CUDA_ARCH__)
    const float* numbers = &from->x[0];
    for (int j = 0; j < 8; ++j) {{
        {_ON_CUDA}
        {_WORKED_OUT}
        const float normal_z = 1.0f / ::sqrt(square), normal_x = rise_x * normal_z, normal_y = rise_y * normal_z;
        {_STORED_ON_CUDA}
    }}
#else
    typedef float floats __attribute__((ext_vector_type(8)));
    floats a, b;
    __builtin_memcpy(&a, &from->x, sizeof(a));
    __builtin_memcpy(&b, &from->z.data[0][2], sizeof(b));
    {_ON_CPU}
    {_WORKED_OUT}
    for (int j = 0; j < 8; ++j) square[j] = __builtin_sqrtf(square[j]);
    const floats normal_z = 1.0f / square, normal_x = rise_x * normal_z, normal_y = rise_y * normal_z;
    {_STORED}
#endif
""")
def compose(patches: wp.array[Patch], k: int, block: wp.array[TriangleBlock]):  # type: ignore[no-untyped-def]
    """Make a block of the triangles of patch k, without their faces; what is not there has x or y of NaN."""
