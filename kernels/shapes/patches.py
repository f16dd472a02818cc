"""The surface of a height field: no triangle of it is stored, for each is made where rays come near it.

      row 2 +---+---+     A patch is two by two cells, eight triangles: number j is that of the cell in row j / 2 % 2
            |6 /|7 /|     and column j % 2 which lies below its diagonal or, from 4 on, above it.
            | /2| /3|
      row 1 +---+---+     Corners are those of the cell of lower row and column, of higher ones, and between these the
            |4 /|5 /|     third corner below the diagonal; above it the third one comes last.
            | /0| /1|
      row 0 +---+---+

      +---+---+---+---+   A plot is eight patches, in two rows of four: patch j of plot k has the number 8 k + j. It is
      | 4 | 5 | 6 | 7 |   a node of the tree whose boxes are not stored either, but made of its heights, which are
      +---+---+---+---+   three cache lines; the node alone would be four, and each patch another one.
      | 0 | 1 | 2 | 3 |
      +---+---+---+---+   Where there are no more cells, x or y of corners is NaN, and z that of the last ones.

The normal of a triangle that rises by a per metre along x and by b along y is (-a, -b, 1) / sqrt(1 + a^2 + b^2). In
float32 each of a and b has the rounding of two differences and a quotient, and the product with the root one more: the
normal is off by 4u, u = eps / 2, apart from its length, which t = w . n / (d . n) does not depend on. Where a or b
overflows or a side is 0 m long, it is 0 or NaN, which leaves the distance to float64.

All of this is the CPU's, which stores the plots of small fields as nodes, too (see
rigcast.kernels.world.stored_trees). CUDA stores patches, and plots as nodes.
"""

import warp as wp

from rigcast.kernels.elements import int_at
from rigcast.kernels.geometry import Plot, TriangleBlock
from rigcast.kernels.trees.nodes import FIRST_PATCH, OUTWARDS, Node

ROWS, COLUMNS = 4, 8
"""Of the cells of a plot."""

_GIVEN = ("x0", "y0", "z0", "x1", "y1", "z1", "x2", "y2", "z2", "normal_x", "normal_y", "normal_z")
_STORED = "".join(f"__builtin_memcpy(&to->{name}, &{name}, sizeof({name}));" for name in _GIVEN)


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef float two __attribute__((ext_vector_type(2)));
    typedef float four __attribute__((ext_vector_type(4)));
    typedef float floats __attribute__((ext_vector_type(8)));
    const auto& plot = *wp::address(plots, k >> 3);
    auto* to = wp::address(block, 0);
    const int row = (k >> 2 & 1) * 2, column = (k & 3) * 2;
    const auto read = [](const float* from) {{ two pair; __builtin_memcpy(&pair, from, sizeof(pair)); return pair; }};
    const auto join = [](four a, four b) {{ return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7); }};
    // of two columns or rows of cells the lower and the higher corners, for all eight triangles
    const auto by_column = [&](int first) {{
        const two x = read(&sides.data[plot.x + column + first]);
        return __builtin_shufflevector(x, x, 0, 1, 0, 1, 0, 1, 0, 1);
    }};
    const auto by_row = [&](int first) {{
        const two y = read(&sides.data[plot.y + row + first]);
        return __builtin_shufflevector(y, y, 0, 0, 1, 1, 0, 0, 1, 1);
    }};
    const auto heights = [&](int first_row, int first) {{  // of a corner of each of the four cells
        const float* z = &plot.z.data[row + first_row][column + first];
        return __builtin_shufflevector(read(z), read(z + {COLUMNS + 1}), 0, 1, 2, 3);
    }};
    const floats low_x = by_column(0), high_x = by_column(1), low_y = by_row(0), high_y = by_row(1);
    const four z00 = heights(0, 0), z01 = heights(0, 1), z10 = heights(1, 0), z11 = heights(1, 1);
    const floats none_x = high_x - high_x, none_y = high_y - high_y;  // NaN where there is no such cell, else 0
    const floats x0 = low_x + none_x, x1 = high_x;
    const floats x2 = __builtin_shufflevector(x1, x0, 0, 1, 2, 3, 12, 13, 14, 15);
    const floats y0 = low_y + none_y;
    const floats y1 = __builtin_shufflevector(y0, high_y, 0, 1, 2, 3, 12, 13, 14, 15);
    const floats y2 = high_y;
    const floats z0 = join(z00, z00), z1 = join(z01, z11), z2 = join(z11, z10);
    // each triangle rises along one axis, then along the other one; these are -a and -b
    const floats rise_x = (join(z00, z10) - z1) / (x1 - x0), rise_y = (join(z01, z00) - z2) / (y2 - y0);
    floats square = 1.0f + rise_x * rise_x + rise_y * rise_y;
    for (int j = 0; j < 8; ++j) square[j] = __builtin_sqrtf(square[j]);
    const floats normal_z = 1.0f / square, normal_x = rise_x * normal_z, normal_y = rise_y * normal_z;
    {_STORED}
#endif
""")
def compose(plots: wp.array[Plot], sides: wp.array[float], k: int, block: wp.array[TriangleBlock]):  # type: ignore[no-untyped-def]
    """Make a block of the triangles of patch k, without their faces; what is not there has x or y of NaN."""


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef float four __attribute__((ext_vector_type(4)));
    typedef float floats __attribute__((ext_vector_type(8)));
    const auto& plot = *wp::address(plots, k);
    auto* to = wp::address(node, 0);
    const auto read = [](const float* from) {{
        floats eight;
        __builtin_memcpy(&eight, from, sizeof(eight));
        return eight;
    }};
    const auto write = [](auto& field, floats eight) {{ __builtin_memcpy(&field, &eight, sizeof(eight)); }};
    const auto twice = [](const float* from) {{
        four own;
        __builtin_memcpy(&own, from, sizeof(own));
        return __builtin_shufflevector(own, own, 0, 1, 2, 3, 0, 1, 2, 3);
    }};
    const auto less = [](floats a, floats b) {{ return a < b ? a : b; }};
    const auto more = [](floats a, floats b) {{ return a > b ? a : b; }};
    // the ends along z of three by three corners each, first by columns: those from 0 on, and those from 1 on
    const float* z = &plot.z.data[0][0];
    const auto end = [&](auto of) {{
        floats columns[2][2];
        for (int first = 0; first < 2; ++first) {{
            const floats middle = read(z + 18 + first);
            columns[0][first] = of(of(read(z + first), read(z + 9 + first)), middle);
            columns[1][first] = of(of(middle, read(z + 27 + first)), read(z + 36 + first));
        }}
        const floats a = __builtin_shufflevector(columns[0][0], columns[1][0], 0, 2, 4, 6, 8, 10, 12, 14);
        const floats b = __builtin_shufflevector(columns[0][0], columns[1][0], 1, 3, 5, 7, 9, 11, 13, 15);
        const floats c = __builtin_shufflevector(columns[0][1], columns[1][1], 1, 3, 5, 7, 9, 11, 13, 15);
        return of(of(a, b), c);
    }};
    const floats low = end(less), high = end(more);
    const floats middle = 0.5f * low + 0.5f * high;
    const float *x = &sides.data[plot.x + {COLUMNS + 1}], *y = &sides.data[plot.y + {ROWS + 1}];
    write(to->center_x, twice(x));
    write(to->half_x, twice(x + 4));
    write(to->center_y, read(y));
    write(to->half_y, read(y + 8));
    write(to->center_z, middle);
    write(to->half_z, more(high - middle, middle - low) * {float(OUTWARDS)!r}f);
    for (int j = 0; j < 8; ++j) to->child[j] = -1 - ({int(FIRST_PATCH)} + 8 * k + j);
#endif
""")
def open_plot(plots: wp.array[Plot], sides: wp.array[float], k: int, node: wp.array[Node]):  # type: ignore[no-untyped-def]
    """Make the node that plot k is, whose children are its patches."""


@wp.func
def is_in_plots(fields: wp.array[int], columns: wp.array[int], entry: int) -> bool:
    """Whether a shape, by its place in arrays of sizes, is a height field whose plots are not stored as nodes.

    fields, columns: as Geometry has them.
    """
    if fields.shape[0] == 0:
        return False
    return int_at(columns, entry) > 0
