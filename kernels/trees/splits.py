"""Where to split a set of boxes in two, by the surface-area heuristic, on the CPU.

Boxes are split where the areas of the two sides, each times the leaves that its boxes fill, are least, among the planes
between BINS bins along each axis (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007).
"""

import warp as wp

from .boxes import Box, empty_box, half_area, join

BINS = wp.constant(16)

vec16 = wp.types.vector(length=16, dtype=wp.float32)


@wp.struct
class Boxes:
    """What a tree is built over, in the order in which its leaves hold it, and the number that each had before."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]
    order: wp.array[int]


@wp.struct
class Bin:
    """The boxes whose centres fall into it: that around them, and how many they are."""

    box: Box
    count: int


@wp.struct
class Grid:
    """Where the bins are: bin = (centre - base) * scale."""

    base: wp.vec3
    scale: wp.vec3


@wp.struct
class Split:
    """Bins up to last_left_bin of the axis go left; axis -1 where no split was found."""

    axis: int
    last_left_bin: int
    cost: float


@wp.func
def center(boxes: Boxes, i: int) -> wp.vec3:
    return 0.5 * boxes.lower[i] + 0.5 * boxes.upper[i]


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
def bin_of(grid: Grid, axis: int, point: wp.vec3) -> int:
    at = (point[axis] - grid.base[axis]) * grid.scale[axis]
    # kept in range as a float, NaN to 0: what int() makes of a float beyond its range is undefined
    return int(wp.where(at > 0.0, wp.min(at, float(BINS - 1)), 0.0))


@wp.func
def bounds(boxes: Boxes, first: int, count: int) -> Box:
    box = empty_box()
    for i in range(first, first + count):
        box = join(box, boxes.lower[i], boxes.upper[i])
    return box


@wp.func
def center_bounds(boxes: Boxes, first: int, count: int) -> Box:
    box = empty_box()
    for i in range(first, first + count):
        point = center(boxes, i)
        box = join(box, point, point)
    return box


@wp.func
def grid_over(centers: Box) -> Grid:
    grid = Grid()
    grid.base = centers.lower
    for axis in range(3):
        extent = centers.upper[axis] - centers.lower[axis]
        grid.scale[axis] = wp.where(extent > 0.0, float(BINS) / extent, 0.0)
    return grid


@wp.func
def fill_bins(boxes: Boxes, first: int, count: int, grid: Grid, bins: wp.array[Bin], first_bin: int) -> None:
    for b in range(first_bin, first_bin + 3 * BINS):
        empty = Bin()
        empty.box = empty_box()
        bins[b] = empty
    for i in range(first, first + count):
        point = center(boxes, i)
        for axis in range(3):
            at = first_bin + axis * BINS + bin_of(grid, axis, point)
            filled = bins[at]
            filled.box = join(filled.box, boxes.lower[i], boxes.upper[i])
            filled.count += 1
            bins[at] = filled


@wp.func
def side_cost(box: Box, count: int, leaf_size: int) -> float:
    """Area x leaves, the expected cost of one side of a split; +inf for a side without boxes."""
    leaves = (count + leaf_size - 1) / leaf_size
    return wp.where(count > 0, half_area(box) * float(leaves), wp.inf)


@wp.func
def best_split_along(axis: int, bins: wp.array[Bin], first_bin: int, leaf_size: int, best: Split) -> Split:
    right_cost = vec16()
    box = empty_box()
    count = int(0)
    for k in range(BINS - 1):
        b = BINS - 1 - k
        one = bins[first_bin + axis * BINS + b]
        box = join(box, one.box.lower, one.box.upper)
        count += one.count
        right_cost[b] = side_cost(box, count, leaf_size)
    box = empty_box()
    count = int(0)
    for b in range(BINS - 1):
        one = bins[first_bin + axis * BINS + b]
        box = join(box, one.box.lower, one.box.upper)
        count += one.count
        cost = side_cost(box, count, leaf_size) + right_cost[b + 1]
        if cost < best.cost:
            best.cost = cost
            best.axis = axis
            best.last_left_bin = b
    return best


@wp.func
def partition(boxes: Boxes, first: int, count: int, grid: Grid, split: Split) -> int:
    """Move the boxes left of the split to the front; return how many they are."""
    i = int(first)
    j = int(first + count - 1)
    while i <= j:
        if bin_of(grid, split.axis, center(boxes, i)) <= split.last_left_bin:
            i += 1
        else:
            swap(boxes, i, j)
            j -= 1
    return i - first


@wp.func
def split_by_sah(boxes: Boxes, first: int, count: int, leaf_size: int, bins: wp.array[Bin], first_bin: int) -> int:
    """Reorder the boxes along the split of least cost; return how many lie left of it, 0 if there is none."""
    grid = grid_over(center_bounds(boxes, first, count))
    fill_bins(boxes, first, count, grid, bins, first_bin)
    split = Split()
    split.axis = -1
    split.cost = wp.inf
    for axis in range(3):
        split = best_split_along(axis, bins, first_bin, leaf_size, split)
    if split.axis < 0:
        return 0
    return partition(boxes, first, count, grid, split)


@wp.func
def split_boxes(
    boxes: Boxes, first: int, count: int, leaf_size: int, balanced: bool, bins: wp.array[Bin], first_bin: int
) -> int:
    """Reorder two boxes or more; return how many go left, at least one and not all.

    Where the heuristic finds no split, and always if balanced, half of them do.
    """
    left_count = int(0)
    if not balanced:
        left_count = split_by_sah(boxes, first, count, leaf_size, bins, first_bin)
    if left_count == 0 or left_count == count:
        return count >> 1
    return left_count
