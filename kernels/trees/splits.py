"""Splits of a set of boxes in two by the binned surface-area heuristic (SAH), on the CPU.

A split minimises the sum over both sides of area times number of leaves that the side's boxes fill, among the planes
between BINS bins along each axis (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007).

A split takes two passes over the boxes: one fills the bins, one partitions the boxes. Both also give the extents of the
two sides. Loops over boxes are `while`: the compiler would keep the counter of a `for` in memory.
"""

import warp as wp

from rigcast.kernels.vectors import larger, smaller

from .boxes import Box, half_area

BINS = wp.constant(16)

vec16 = wp.types.vector(length=16, dtype=wp.float32)


@wp.struct
class Boxes:
    """The boxes that a tree is built over, reordered to the order of its leaves; order: each box's original index."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]
    order: wp.array[int]


@wp.struct
class Box4:
    """A box whose ends fill a vector register each; their fourth component is 0."""

    low: wp.vec4
    high: wp.vec4


@wp.struct
class Extent:
    """The box around a set of boxes, and the box around their centres."""

    box: Box4
    centers: Box4


@wp.struct
class Halves:
    """The two sides of a split: the first left_count boxes, and the others."""

    left_count: int
    left: Extent
    right: Extent


@wp.struct
class Bin:
    """The box around all boxes whose centres fall into a bin, and their number."""

    box: Box4
    count: int


@wp.struct
class Grid:
    """The placement of the bins: bin = (centre - base) * scale, per axis."""

    base: wp.vec4
    scale: wp.vec4


@wp.struct
class Split:
    """Bins up to last_left_bin of the axis go left; axis -1 where no split was found."""

    axis: int
    last_left_bin: int
    cost: float


@wp.func
def wide(a: wp.vec3) -> wp.vec4:
    return wp.vec4(a[0], a[1], a[2], 0.0)


@wp.func
def box4_at(boxes: Boxes, i: int) -> Box4:
    box = Box4()
    box.low = wide(boxes.lower[i])
    box.high = wide(boxes.upper[i])
    return box


@wp.func
def empty_box4() -> Box4:
    box = Box4()
    box.low = wp.vec4(wp.inf, wp.inf, wp.inf, 0.0)
    box.high = wp.vec4(-wp.inf, -wp.inf, -wp.inf, 0.0)
    return box


@wp.func
def lowest(a: wp.vec4, b: wp.vec4) -> wp.vec4:
    return wp.vec4(smaller(a[0], b[0]), smaller(a[1], b[1]), smaller(a[2], b[2]), 0.0)


@wp.func
def highest(a: wp.vec4, b: wp.vec4) -> wp.vec4:
    return wp.vec4(larger(a[0], b[0]), larger(a[1], b[1]), larger(a[2], b[2]), 0.0)


@wp.func
def joined(a: Box4, low: wp.vec4, high: wp.vec4) -> Box4:
    box = Box4()
    box.low = lowest(a.low, low)
    box.high = highest(a.high, high)
    return box


@wp.func
def box_of(a: Box4) -> Box:
    box = Box()
    box.lower = wp.vec3(a.low[0], a.low[1], a.low[2])
    box.upper = wp.vec3(a.high[0], a.high[1], a.high[2])
    return box


@wp.func
def center(box: Box4) -> wp.vec4:
    return 0.5 * box.low + 0.5 * box.high


@wp.func
def swap(boxes: Boxes, i: int, j: int) -> None:
    lower = wp.vec3(boxes.lower[i])
    upper = wp.vec3(boxes.upper[i])
    number = int(boxes.order[i])
    boxes.lower[i] = boxes.lower[j]
    boxes.upper[i] = boxes.upper[j]
    boxes.order[i] = boxes.order[j]
    boxes.lower[j] = lower
    boxes.upper[j] = upper
    boxes.order[j] = number


@wp.func
def bin_of(grid: Grid, axis: int, point: wp.vec4) -> int:
    at = (point[axis] - grid.base[axis]) * grid.scale[axis]
    # clamped as a float, with NaN to 0: int() of a float beyond its range is undefined
    return int(wp.where(at > 0.0, wp.min(at, float(BINS - 1)), 0.0))


@wp.func
def no_extent() -> Extent:
    extent = Extent()
    extent.box = empty_box4()
    extent.centers = empty_box4()
    return extent


@wp.func
def extent_of(boxes: Boxes, first: int, count: int) -> Extent:
    extent = no_extent()
    i = int(first)
    while i < first + count:
        own = box4_at(boxes, i)
        point = center(own)
        extent.box = joined(extent.box, own.low, own.high)
        extent.centers = joined(extent.centers, point, point)
        i += 1
    return extent


@wp.func
def grid_over(centers: Box4) -> Grid:
    grid = Grid()
    grid.base = centers.low
    for axis in range(3):
        extent = centers.high[axis] - centers.low[axis]
        grid.scale[axis] = wp.where(extent > 0.0, float(BINS) / extent, 0.0)
    return grid


@wp.func
def fill_bins(boxes: Boxes, first: int, count: int, grid: Grid, bins: wp.array[Bin], first_bin: int) -> None:
    for b in range(first_bin, first_bin + 3 * BINS):
        empty = Bin()
        empty.box = empty_box4()
        bins[b] = empty
    i = int(first)
    while i < first + count:
        own = box4_at(boxes, i)
        point = center(own)
        for axis in range(3):
            at = first_bin + axis * BINS + bin_of(grid, axis, point)
            filled = bins[at]
            filled.box = joined(filled.box, own.low, own.high)
            filled.count += 1
            bins[at] = filled
        i += 1


@wp.func
def side_cost(box: Box4, count: int, leaf_size: int) -> float:
    """Expected cost of one side of a split: half area x leaves; +inf for a side without boxes."""
    leaves = (count + leaf_size - 1) / leaf_size
    return wp.where(count > 0, half_area(box_of(box)) * float(leaves), wp.inf)


@wp.func
def best_split_along(axis: int, bins: wp.array[Bin], first_bin: int, leaf_size: int, best: Split) -> Split:
    right_cost = vec16()
    box = empty_box4()
    count = int(0)
    for k in range(BINS - 1):
        b = BINS - 1 - k
        one = bins[first_bin + axis * BINS + b]
        box = joined(box, one.box.low, one.box.high)
        count += one.count
        right_cost[b] = side_cost(box, count, leaf_size)
    box = empty_box4()
    count = int(0)
    for b in range(BINS - 1):
        one = bins[first_bin + axis * BINS + b]
        box = joined(box, one.box.low, one.box.high)
        count += one.count
        cost = side_cost(box, count, leaf_size) + right_cost[b + 1]
        if cost < best.cost:
            best.cost = cost
            best.axis = axis
            best.last_left_bin = b
    return best


@wp.func
def partition(boxes: Boxes, first: int, count: int, grid: Grid, split: Split) -> Halves:
    """Move the boxes left of the split to the front. Sets the boxes around the centres; those around the boxes
    themselves come from the bins."""
    left = empty_box4()
    right = empty_box4()
    i = int(first)
    j = int(first + count - 1)
    while i <= j:
        point = center(box4_at(boxes, i))
        if bin_of(grid, split.axis, point) <= split.last_left_bin:
            left = joined(left, point, point)
            i += 1
        else:
            right = joined(right, point, point)
            swap(boxes, i, j)
            j -= 1
    halves = Halves()
    halves.left_count = i - first
    halves.left.centers = left
    halves.right.centers = right
    return halves


@wp.func
def joined_bins(bins: wp.array[Bin], begin: int, end: int) -> Box4:
    box = empty_box4()
    for b in range(begin, end):
        box = joined(box, bins[b].box.low, bins[b].box.high)
    return box


@wp.func
def split_by_sah(
    boxes: Boxes, first: int, count: int, centers: Box4, leaf_size: int, bins: wp.array[Bin], first_bin: int
) -> Halves:
    """Partition the boxes by the split of least cost; left_count is 0 if there is none."""
    grid = grid_over(centers)
    fill_bins(boxes, first, count, grid, bins, first_bin)
    split = Split()
    split.axis = -1
    split.cost = wp.inf
    for axis in range(3):
        split = best_split_along(axis, bins, first_bin, leaf_size, split)
    halves = Halves()
    if split.axis >= 0:
        halves = partition(boxes, first, count, grid, split)
        begin = first_bin + split.axis * BINS
        middle = begin + split.last_left_bin + 1
        halves.left.box = joined_bins(bins, begin, middle)
        halves.right.box = joined_bins(bins, middle, begin + BINS)
    return halves


@wp.func
def split_boxes(
    boxes: Boxes,
    first: int,
    count: int,
    centers: Box4,
    leaf_size: int,
    balanced: bool,
    bins: wp.array[Bin],
    first_bin: int,
) -> Halves:
    """Partition two or more boxes so that neither side is empty. centers: the box around their centres.

    Without a split by the heuristic, and always if balanced, the first half of the boxes goes left.
    """
    halves = Halves()
    if not balanced:
        halves = split_by_sah(boxes, first, count, centers, leaf_size, bins, first_bin)
    if halves.left_count == 0 or halves.left_count == count:
        half = count >> 1
        halves.left_count = half
        halves.left = extent_of(boxes, first, half)
        halves.right = extent_of(boxes, first + half, count - half)
    return halves
