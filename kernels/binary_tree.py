"""Binary trees over boxes by the surface-area heuristic, on one thread of the CPU.

A node is split where the areas of the two sides, each times the number of boxes in it, are least, among the planes
between BINS bins along each axis (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007).
"""

import warp as wp

from .boxes import Box, empty_box, half_area, join

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

BINS = wp.constant(16)

vec16 = wp.types.vector(length=16, dtype=wp.float32)


@wp.struct
class BinaryTree:
    """Nodes over order[first : first + count]; children at left and left + 1, or none where left is 0."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]
    first: wp.array[int]
    count: wp.array[int]
    left: wp.array[int]


@wp.struct
class Boxes:
    """What a tree is built over, in the order in which its leaves hold it, and the number that each had before."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]
    order: wp.array[int]


@wp.struct
class Bins:
    """(3, BINS): the boxes whose centres fall into each of the bins along each axis."""

    lower: wp.array2d[wp.vec3]
    upper: wp.array2d[wp.vec3]
    count: wp.array2d[int]


@wp.struct
class Grid:
    """Where the bins of a node are: bin = (centre - base) * scale."""

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
def fill_bins(boxes: Boxes, first: int, count: int, grid: Grid, bins: Bins) -> None:
    for axis in range(3):
        for b in range(BINS):
            bins.lower[axis, b] = wp.vec3(wp.inf, wp.inf, wp.inf)
            bins.upper[axis, b] = wp.vec3(-wp.inf, -wp.inf, -wp.inf)
            bins.count[axis, b] = 0
    for i in range(first, first + count):
        point = center(boxes, i)
        for axis in range(3):
            b = bin_of(grid, axis, point)
            bins.lower[axis, b] = wp.min(bins.lower[axis, b], boxes.lower[i])
            bins.upper[axis, b] = wp.max(bins.upper[axis, b], boxes.upper[i])
            bins.count[axis, b] = bins.count[axis, b] + 1


@wp.func
def side_cost(box: Box, count: int) -> float:
    """Area x count, the expected cost of one side of a split; +inf for a side without boxes."""
    return wp.where(count > 0, half_area(box) * float(count), wp.inf)


@wp.func
def best_split_along(axis: int, bins: Bins, best: Split) -> Split:
    right_cost = vec16()
    box = empty_box()
    count = int(0)
    for k in range(BINS - 1):
        b = BINS - 1 - k
        box = join(box, bins.lower[axis, b], bins.upper[axis, b])
        count += bins.count[axis, b]
        right_cost[b] = side_cost(box, count)
    box = empty_box()
    count = int(0)
    for b in range(BINS - 1):
        box = join(box, bins.lower[axis, b], bins.upper[axis, b])
        count += bins.count[axis, b]
        cost = side_cost(box, count) + right_cost[b + 1]
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
def split_by_sah(boxes: Boxes, first: int, count: int, bins: Bins) -> int:
    """Reorder the boxes along the split of least cost; return how many lie left of it, 0 if there is none."""
    grid = grid_over(center_bounds(boxes, first, count))
    fill_bins(boxes, first, count, grid, bins)
    split = Split()
    split.axis = -1
    split.cost = wp.inf
    for axis in range(3):
        split = best_split_along(axis, bins, split)
    if split.axis < 0:
        return 0
    return partition(boxes, first, count, grid, split)


@wp.kernel
def build_binary(
    boxes: Boxes,
    leaf_size: int,
    balanced: bool,
    # scratch:
    bins: Bins,
    todo: wp.array[int],  # one per box
    # out:
    tree: BinaryTree,
    size: wp.array[int],
) -> None:
    """One thread. A node is settled with all that is below it before its neighbour is, so that boxes stay in the cache.

    Where the heuristic finds no split, and everywhere if balanced, a node is halved by count instead.
    """
    tree.first[0] = 0
    tree.count[0] = boxes.order.shape[0]
    total = int(1)
    todo[0] = 0
    left_to_do = int(1)
    while left_to_do > 0:
        left_to_do -= 1
        node = todo[left_to_do]
        first = tree.first[node]
        count = tree.count[node]
        box = bounds(boxes, first, count)
        tree.lower[node] = box.lower
        tree.upper[node] = box.upper
        tree.left[node] = 0
        if count > leaf_size:
            left_count = int(0)
            if not balanced:
                left_count = split_by_sah(boxes, first, count, bins)
            if left_count == 0 or left_count == count:
                left_count = count / 2
            for side in range(2):
                tree.first[total + side] = first + side * left_count
                tree.count[total + side] = wp.where(side == 0, left_count, count - left_count)
                todo[left_to_do + side] = total + side
            tree.left[node] = total
            total += 2
            left_to_do += 2
    size[0] = total


@wp.func
def box_of(tree: BinaryTree, node: int) -> Box:
    box = Box()
    box.lower = tree.lower[node]
    box.upper = tree.upper[node]
    return box
