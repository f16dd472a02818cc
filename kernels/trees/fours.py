"""Trees with up to four children a node, which CUDA casts through, made of the trees with up to eight.

First the children of each node are paired: the two with the smallest box around both, until one pair is left. A node of
the new tree stands for a pair; its children are the pair's sides, the largest of them opened in turn, until they are
four.
"""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.launch import launch

from .boxes import Box, half_area, join
from .fit import make_box
from .nodes import FOUR, NO_CHILD, WIDTH, Four, vec8i
from .tree import STACK

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

ENTRIES = wp.constant(2 * WIDTH - 1)
"""Entries of a node's binary tree: its children, then the pairs."""

Boxes = npt.NDArray[np.float32]


@wp.struct
class Pairs:
    """Binary trees over the children of nodes. Entry ENTRIES i + j is child j of node i if j < WIDTH, else a pair."""

    lower: wp.array[wp.vec3]
    upper: wp.array[wp.vec3]
    child: wp.array[int]  # of entries that are children; NO_CHILD for pairs
    sides: wp.array[wp.vec2i]  # entries that a pair joins; these are leaves or pairs
    height: wp.array[int]  # levels of pairs below and with a pair; 0 for leaves
    top: wp.array[int]  # (nodes,) the entry that stands for each node, -1 if it has no leaves


@wp.struct
class FoursMade:
    """Nodes as they are made. entry: the pair of each; pending: the entries of a traversal's stack when it comes there,
    at most."""

    fours: wp.array[Four]
    entry: wp.array[int]
    pending: wp.array[int]
    count: wp.array[int]  # (1,)


@wp.func
def absent_four() -> Four:
    four = Four()
    for j in range(FOUR):
        four.lower_x[j] = wp.inf
        four.lower_y[j] = wp.inf
        four.lower_z[j] = wp.inf
        four.upper_x[j] = -wp.inf
        four.upper_y[j] = -wp.inf
        four.upper_z[j] = -wp.inf
        four.child[j] = NO_CHILD
    return four


@wp.func
def box_around(pairs: Pairs, a: int, b: int) -> Box:
    return join(make_box(pairs.lower[a], pairs.upper[a]), pairs.lower[b], pairs.upper[b])


@wp.func
def finite_area(box: Box) -> float:
    """Half the area of a box [m^2], a large number if that is not finite."""
    area = half_area(box)
    return wp.where(area < 1.0e38, area, 1.0e38)


@wp.func
def nearest_two(pairs: Pairs, entries: vec8i, count: int) -> wp.vec2i:
    """The positions a < b of the two entries with the smallest box around both; of several, as those with unbounded
    ones are, the lowest two."""
    best = wp.vec2i(0, 1)
    smallest = float(wp.inf)
    lowest = int(0)
    for b in range(1, count):
        for a in range(b):
            area = finite_area(box_around(pairs, entries[a], entries[b]))
            height = wp.max(pairs.height[entries[a]], pairs.height[entries[b]])
            if area < smallest or (area == smallest and height < lowest):
                smallest = area
                lowest = height
                best = wp.vec2i(a, b)
    return best


@wp.func
def pair_children(pairs: Pairs, i: int) -> None:
    """Pair the children of node i; nodes among them must have been paired before."""
    entries = vec8i()
    count = int(0)
    for j in range(WIDTH):
        entry = ENTRIES * i + j
        child = pairs.child[entry]
        if child >= 0:
            entry = pairs.top[child]
        if child != NO_CHILD and entry >= 0:
            entries[count] = entry
            count += 1
    made = ENTRIES * i + WIDTH
    while count > 1:
        best = nearest_two(pairs, entries, count)
        a = entries[best[0]]
        b = entries[best[1]]
        box = box_around(pairs, a, b)
        pairs.lower[made] = box.lower
        pairs.upper[made] = box.upper
        pairs.child[made] = NO_CHILD
        pairs.sides[made] = wp.vec2i(a, b)
        pairs.height[made] = 1 + wp.max(pairs.height[a], pairs.height[b])
        count -= 1
        entries[best[1]] = entries[count]
        entries[best[0]] = made
        made += 1
    pairs.top[i] = -1
    if count == 1:
        pairs.top[i] = entries[0]


@wp.func
def largest_pair(pairs: Pairs, slots: wp.vec4i, count: int) -> int:
    """The position of the pair with the largest box, -1 if there is none."""
    best = int(-1)
    largest = float(-1.0)
    for j in range(count):
        entry = slots[j]
        if pairs.height[entry] > 0:
            area = finite_area(make_box(pairs.lower[entry], pairs.upper[entry]))
            if area > largest:
                largest = area
                best = j
    return best


@wp.func
def opened(pairs: Pairs, entry: int, pending: int) -> wp.vec4i:
    """The entries of the node that stands for this one, then -1.

    A traversal's stack is to hold no more than STACK entries. The levels of pairs below could be taken one by one, with
    one more entry each; so as many must remain free.
    """
    slots = wp.vec4i(entry, -1, -1, -1)
    count = int(1)
    largest = largest_pair(pairs, slots, count)
    while count < FOUR and largest >= 0 and (count == 1 or pending + count + pairs.height[entry] <= STACK):
        sides = pairs.sides[slots[largest]]
        slots[largest] = sides[0]
        slots[count] = sides[1]
        count += 1
        largest = largest_pair(pairs, slots, count)
    return slots


@wp.func
def make_four(pairs: Pairs, made: FoursMade, at: int) -> None:
    """Make the node `at`, and append an entry for each of its children that is a node."""
    slots = opened(pairs, made.entry[at], made.pending[at])
    count = int(0)
    for j in range(FOUR):
        if slots[j] >= 0:
            count += 1
    four = absent_four()
    for j in range(count):
        entry = slots[j]
        lower = pairs.lower[entry]
        upper = pairs.upper[entry]
        four.lower_x[j] = lower[0]
        four.lower_y[j] = lower[1]
        four.lower_z[j] = lower[2]
        four.upper_x[j] = upper[0]
        four.upper_y[j] = upper[1]
        four.upper_z[j] = upper[2]
        four.child[j] = pairs.child[entry]
        if pairs.height[entry] > 0:
            four.child[j] = made.count[0]
            made.entry[made.count[0]] = entry
            made.pending[made.count[0]] = made.pending[at] + count - 1
            made.count[0] += 1
    made.fours[at] = four


@wp.kernel
def make_fours(pairs: Pairs, made: FoursMade) -> None:
    """Make the tree whose root stands for node 0, level by level. One thread makes all."""
    for k in range(pairs.top.shape[0]):
        pair_children(pairs, pairs.top.shape[0] - 1 - k)
    made.count[0] = 1
    made.entry[0] = pairs.top[0]
    made.pending[0] = 0
    made.fours[0] = absent_four()
    at = int(0)
    while at < made.count[0] and made.entry[0] >= 0:
        make_four(pairs, made, at)
        at += 1


def in_fours(child: npt.NDArray[np.int32], lower: Boxes, upper: Boxes) -> npt.NDArray[np.void]:
    """The tree in an array of Four: node 0 is the root, and nodes are in the order of their levels.

    child: (n, 8) of Node, node 0 being the root. lower, upper: (n, 8, 3) ends of the children's boxes [m]; of children
    that are nodes they are not used.
    """
    n = len(child)
    pairs = Pairs()
    pairs.lower, pairs.upper = (wp.array(_with_room(a), dtype=wp.vec3, device="cpu") for a in (lower, upper))
    pairs.child = wp.array(_with_room(child), dtype=int, device="cpu")
    pairs.sides = wp.empty(n * ENTRIES, dtype=wp.vec2i, device="cpu")
    pairs.height = wp.zeros(n * ENTRIES, dtype=int, device="cpu")
    pairs.top = wp.empty(n, dtype=int, device="cpu")
    most = max(1, int(((child < 0) & (child != NO_CHILD)).sum()))  # a node joins at least two others
    made = FoursMade()
    made.fours = wp.empty(most, dtype=Four, device="cpu")
    made.entry, made.pending = (wp.empty(most, dtype=int, device="cpu") for _ in range(2))
    made.count = wp.zeros(1, dtype=int, device="cpu")
    launch(make_fours, 1, [pairs, made], [], "cpu")
    return made.fours.numpy()[: made.count.numpy()[0]].copy()


def _with_room(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """The values of children (n, 8, ...), with room for pairs after those of each node (n ENTRIES, ...)."""
    room = np.zeros((len(values), ENTRIES - WIDTH, *values.shape[2:]), values.dtype)
    return np.concatenate([values, room], axis=1).reshape(-1, *values.shape[2:])


def boxes_of_leaves(child: npt.NDArray[np.int32], lower: Boxes, upper: Boxes) -> tuple[Boxes, Boxes]:
    """The ends (n, 8, 3) of children's boxes for `in_fours`, where leaf k has the ends lower[k], upper[k] [m]."""
    is_leaf = (child < 0) & (child != NO_CHILD)
    ends = np.zeros((2, *child.shape, 3), np.float32)
    ends[:, is_leaf] = lower[~child[is_leaf]], upper[~child[is_leaf]]
    return ends[0], ends[1]


def levels_of(fours: npt.NDArray[np.void]) -> list[int]:
    """Index of each level's first node, and the end of the last level."""
    levels = [0, 1]
    while levels[-1] < len(fours):
        levels.append(int(fours["child"][levels[-2] : levels[-1]].max()) + 1)
    return levels


def moved_fours(fours: npt.NDArray[np.void], first: int) -> npt.NDArray[np.void]:
    """Copy the nodes for an array in which the tree's root has this index."""
    moved = fours.copy()
    moved["child"] += np.where(moved["child"] >= 0, np.int32(first), np.int32(0))
    return moved
