"""The surface of a height field. Its triangles are not stored; they are made when rays come near.

      row 2 +---+---+     A patch is two by two cells with eight triangles. Triangle j belongs to the cell in row
            |6 /|7 /|     j / 2 % 2 and column j % 2. It lies below the cell's diagonal if j < 4, else above it.
            | /2| /3|
      row 1 +---+---+     The order of corners below the diagonal: lower row and column, the third corner, higher row
            |4 /|5 /|     and column. Above the diagonal the third corner comes last.
            | /0| /1|
      row 0 +---+---+

      +---+---+---+---+   A plot is eight patches in two rows of four; patch j of plot k has the number 8 k + j. A plot
      | 4 | 5 | 6 | 7 |   is a node of the tree. Its boxes are not stored either but made from its heights. These take
      +---+---+---+---+   three cache lines, where a node would take four and each patch another one.
      | 0 | 1 | 2 | 3 |
      +---+---+---+---+   Beyond the last cell, x or y of corners is NaN, and z repeats the last height.

The normal of a triangle that rises by a per metre along x and by b per metre along y is
(-a, -b, 1) / sqrt(1 + a^2 + b^2). In float32, a and b each have the rounding of two differences and a quotient, and the
product with the root adds one more. So the direction of the normal is off by 4u, u = eps / 2; its length does not
matter for t = w . n / (d . n). If a or b overflows or a side is 0 m long, the normal is 0 or NaN, and the distance is
left to float64.

This is the layout on the CPU, which stores the plots of small fields as nodes, too (see
rigcast.kernels.world.stored_trees). CUDA stores patches, and plots as nodes.
"""

import warp as wp

from rigcast.kernels.elements import int_at
from rigcast.kernels.geometry import Plot, TriangleBlock
from rigcast.kernels.trees.nodes import FIRST_PATCH, OUTWARDS, Node

ROWS, COLUMNS = 4, 8
"""Rows and columns of cells of a plot."""

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
    """Write the triangles of patch k to block[0], without their face numbers; absent ones have NaN in x or y."""


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
    """Write plot k to node[0] as a node whose children are its patches."""


@wp.func
def is_in_plots(hfields: wp.array[int], columns: wp.array[int], entry: int) -> bool:
    """Whether a shape is a height field whose plots are not stored as nodes.

    hfields, columns: of Geometry. entry: index of the shape in arrays of sizes.
    """
    if hfields.shape[0] == 0:
        return False
    return int_at(columns, entry) > 0
