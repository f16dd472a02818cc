"""The surface of a height field: no triangle of it is stored, for each is made where rays come near it.

      row 2 +---+---+     A patch is two by two cells, eight triangles: number j is that of the cell in row j / 2 % 2
            |6 /|7 /|     and column j % 2 which lies below its diagonal or, from 4 on, above it.
            | /2| /3|
      row 1 +---+---+     Corners are those of the cell of lower row and column, of higher ones, and between these the
            |4 /|5 /|     third corner below the diagonal; above it the third one comes last.
            | /0| /1|
      row 0 +---+---+

      +---+---+---+---+   A plot is eight patches, in two rows of four: patch j of plot k has the number 8 k + j. It is a
      | 4 | 5 | 6 | 7 |   node of the tree whose boxes are not stored either, but made of its heights, which are three
      +---+---+---+---+   cache lines; the node alone would be four, and a patch takes another one where it is stored.
      | 0 | 1 | 2 | 3 |
      +---+---+---+---+   Where there are no more cells, x or y of corners is NaN, and z that of the last ones.

The normal of a triangle that rises by a per metre along x and by b along y is (-a, -b, 1) / sqrt(1 + a^2 + b^2). In
float32 each of a and b has the rounding of two differences and a quotient, and the product with the root one more: the
normal is off by 4u, u = eps / 2, apart from its length, which t = w . n / (d . n) does not depend on. Where a or b
overflows or a side is 0 m long, it is 0 or NaN, which leaves the distance to float64.

All of this is the CPU's. CUDA stores patches, and plots as nodes.
"""

import warp as wp

from rigcast.kernels.geometry import Plot, TriangleBlock
from rigcast.kernels.trees.nodes import FIRST_PATCH, OUTWARDS, Node

_CORNERS = {
    # which numbers of four from x, and of four from y, each of the triangles has
    "x0": ("xy", (0, 1, 0, 1, 0, 1, 0, 1)),
    "y0": ("xy", (4, 4, 5, 5, 4, 4, 5, 5)),
    "x1": ("xy", (1, 2, 1, 2, 1, 2, 1, 2)),
    "y1": ("xy", (4, 4, 5, 5, 5, 5, 6, 6)),
    "x2": ("xy", (1, 2, 1, 2, 0, 1, 0, 1)),
    "y2": ("xy", (5, 5, 6, 6, 5, 5, 6, 6)),
    # and of four from z of each row of corners
    "z0": ("z", (0, 1, 4, 5, 0, 1, 4, 5)),
    "z1": ("z", (1, 2, 5, 6, 5, 6, 9, 10)),
    "z2": ("z", (5, 6, 9, 10, 4, 5, 8, 9)),
    # from where it rises along x to corner 1, and along y to corner 2
    "zx": ("z", (0, 1, 4, 5, 4, 5, 8, 9)),
    "zy": ("z", (1, 2, 5, 6, 0, 1, 4, 5)),
}
_GIVEN = [name for name in _CORNERS if name[1].isdigit()] + ["normal_x", "normal_y", "normal_z"]
_MADE = "".join(
    f"floats {name} = __builtin_shufflevector({of}, {of}, {', '.join(map(str, order))});"
    for name, (of, order) in _CORNERS.items()
)
_STORED = "".join(f"__builtin_memcpy(&to->{name}, &{name}, sizeof({name}));" for name in _GIVEN)


# without a return type, as Warp 1.12 knows none but numbers there
@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef float floats __attribute__((ext_vector_type(8)));
    typedef float four __attribute__((ext_vector_type(4)));
    const auto& plot = *wp::address(plots, k >> 3);
    auto* to = wp::address(block, 0);
    const int row = (k >> 2 & 1) * 2, column = (k & 3) * 2;
    const float* heights = &plot.z.data[row][column];
    // the last of each four is not used
    four x, y, below, middle, above;
    __builtin_memcpy(&x, &corners.data[plot.x + column], sizeof(x));
    __builtin_memcpy(&y, &corners.data[plot.y + row], sizeof(y));
    __builtin_memcpy(&below, heights, sizeof(below));
    __builtin_memcpy(&middle, heights + 9, sizeof(middle));
    __builtin_memcpy(&above, heights + 18, sizeof(above));
    const floats xy = __builtin_shufflevector(x, y, 0, 1, 2, 3, 4, 5, 6, 7);
    const floats lower = __builtin_shufflevector(below, middle, 0, 1, 2, 3, 4, 5, 6, 7);
    const floats upper = __builtin_shufflevector(above, above, 0, 1, 2, 3, -1, -1, -1, -1);
    const auto z = __builtin_shufflevector(lower, upper, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, -1, -1, -1, -1);
    {_MADE}
    x0 += x1 - x1;  // NaN where there is no such triangle, else 0
    x2 += x1 - x1;
    y0 += y2 - y2;
    y1 += y2 - y2;
    const floats rise_x = (zx - z1) / (x1 - x0), rise_y = (zy - z2) / (y2 - y0);
    floats square = 1.0f + rise_x * rise_x + rise_y * rise_y;
    for (int j = 0; j < 8; ++j) square[j] = __builtin_sqrtf(square[j]);
    const floats normal_z = 1.0f / square, normal_x = rise_x * normal_z, normal_y = rise_y * normal_z;
    {_STORED}
#endif
""")
def compose(plots: wp.array[Plot], corners: wp.array[float], k: int, block: wp.array[TriangleBlock]):  # type: ignore[no-untyped-def]
    """Make a block of the triangles of patch k, without their faces; what is not there has x or y of NaN."""


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef float floats __attribute__((ext_vector_type(8)));
    const auto& plot = *wp::address(plots, k);
    auto* to = wp::address(node, 0);
    const auto read = [](const float* from) {{ floats eight; __builtin_memcpy(&eight, from, sizeof(eight)); return eight; }};
    const auto is_less = [](floats a, floats b) {{ return a < b ? a : b; }};
    const auto is_more = [](floats a, floats b) {{ return a > b ? a : b; }};
    const auto write = [](auto& field, floats eight) {{ __builtin_memcpy(&field, &eight, sizeof(eight)); }};
    // of three corners of a row, from every second one on
    floats least[5], most[5];
    for (int row = 0; row < 5; ++row) {{
        const float* heights = &plot.z.data[row][0];
        const floats first = read(heights), second = read(heights + 1), third = read(heights + 2);
        least[row] = is_less(is_less(first, second), third);
        most[row] = is_more(is_more(first, second), third);
    }}
    const floats least_below = is_less(is_less(least[0], least[1]), least[2]);
    const floats least_above = is_less(is_less(least[2], least[3]), least[4]);
    const floats most_below = is_more(is_more(most[0], most[1]), most[2]);
    const floats most_above = is_more(is_more(most[2], most[3]), most[4]);
    const floats low_z = __builtin_shufflevector(least_below, least_above, 0, 2, 4, 6, 8, 10, 12, 14);
    const floats high_z = __builtin_shufflevector(most_below, most_above, 0, 2, 4, 6, 8, 10, 12, 14);
    const floats x = read(&corners.data[plot.x]), x_next = read(&corners.data[plot.x + 1]);
    const floats y = read(&corners.data[plot.y]);
    floats low_x = __builtin_shufflevector(x, x, 0, 2, 4, 6, 0, 2, 4, 6);
    const floats middle_x = __builtin_shufflevector(x, x, 1, 3, 5, 7, 1, 3, 5, 7);
    const floats last_x = __builtin_shufflevector(x_next, x_next, 1, 3, 5, 7, 1, 3, 5, 7);
    const floats low_y = __builtin_shufflevector(y, y, 0, 0, 0, 0, 2, 2, 2, 2);
    const floats middle_y = __builtin_shufflevector(y, y, 1, 1, 1, 1, 3, 3, 3, 3);
    const floats last_y = __builtin_shufflevector(y, y, 2, 2, 2, 2, 4, 4, 4, 4);
    const floats high_x = last_x == last_x ? last_x : middle_x, high_y = last_y == last_y ? last_y : middle_y;
    low_x += middle_y - middle_y;  // NaN where there is no such patch: its box is never met
    const auto write_box = [&](auto& center, auto& half, floats low, floats high) {{
        const floats middle = 0.5f * low + 0.5f * high;
        write(center, middle);
        write(half, is_more(high - middle, middle - low) * {float(OUTWARDS)!r}f);
    }};
    write_box(to->center_x, to->half_x, low_x, high_x);
    write_box(to->center_y, to->half_y, low_y, high_y);
    write_box(to->center_z, to->half_z, low_z, high_z);
    for (int j = 0; j < 8; ++j) to->child[j] = -1 - ({int(FIRST_PATCH)} + 8 * k + j);
#endif
""")
def open_plot(plots: wp.array[Plot], corners: wp.array[float], k: int, node: wp.array[Node]):  # type: ignore[no-untyped-def]
    """Make the node that plot k is, whose children are its patches."""
