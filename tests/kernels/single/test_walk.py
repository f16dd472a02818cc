"""A single ray visits every leaf whose box it enters within its limit, hardly any other, nearest first."""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type,index"

from typing import NamedTuple

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.single.ray import box_margin, inverse_of
from rigcast.kernels.single.walk import NUMBERS_OF_STACK, leaf_of, next_leaf, top_of
from rigcast.kernels.trees.nodes import NO_CHILD, Node
from rigcast.kernels.trees.tree import Tree, build_tree

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

Doubles = NDArray[np.float64]
Floats = NDArray[np.float32]
RAYS, BOXES, OTHERS = 500, 300, 40
ROUNDING = 1e-5  # of coordinates up to 10, and of distances


@wp.kernel
def walk(
    nodes: wp.array[Node],
    origins: wp.array[wp.vec3],
    directions: wp.array[wp.vec3],
    reach: float,
    limits: wp.array[float],
    bottom: int,
    leaves: wp.array2d[int],
) -> None:
    """Write the leaves that each ray visits, in order. bottom: entries on the stack that must stay."""
    i = wp.tid()
    stack = wp.zeros(shape=NUMBERS_OF_STACK, dtype=int)
    d = directions[i]
    inverse = wp.vec3(inverse_of(d[0]), inverse_of(d[1]), inverse_of(d[2]))
    margin = box_margin(origins[i], reach)
    at = int(0)
    top = int(bottom)
    count = int(0)
    while True:
        found = next_leaf(nodes, at, origins[i], inverse, margin, limits[i], stack, top, bottom)
        if leaf_of(found) == NO_CHILD:
            break
        leaves[i, count] = -1 - leaf_of(found)
        count += 1
        top = top_of(found)
        at = NO_CHILD


class Walk(NamedTuple):
    """Boxes (n, 3), one per leaf, and rays (m, 3) among them."""

    lower: Floats
    upper: Floats
    origins: Floats
    directions: Floats


def random_walk(seed: int, along_axes: bool) -> Walk:
    rng = np.random.default_rng(seed)
    centers, half = rng.uniform(-9, 9, (BOXES, 3)), rng.uniform(0, 1, (BOXES, 3))
    directions = rng.normal(size=(RAYS, 3))
    if along_axes:
        directions[np.arange(RAYS), rng.integers(0, 3, RAYS)] = 0.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    boxes = (centers - half).astype(np.float32), (centers + half).astype(np.float32)
    return Walk(*boxes, rng.uniform(-10, 10, (RAYS, 3)).astype(np.float32), directions.astype(np.float32))


def shown(walked: Walk, limits: Floats, bottom: int = 0) -> list[list[int]]:
    """The boxes that each ray visits, in order."""
    tree: Tree = build_tree(walked.lower, walked.upper, leaf_size=1)
    leaves = np.full((RAYS, BOXES), -1, np.int32)
    reach = float(max(np.abs(walked.lower).max(), np.abs(walked.upper).max()))
    vectors = (wp.array(a, dtype=wp.vec3, device="cpu") for a in (walked.origins, walked.directions))
    out = wp.array(leaves, dtype=int, device="cpu", copy=False)
    nodes = wp.array(tree.nodes, dtype=Node, device="cpu")
    wp.launch(
        walk, RAYS, [nodes, *vectors, reach, wp.array(limits, dtype=float, device="cpu"), bottom, out], device="cpu"
    )
    return [tree.order[tree.leaf_first[row[row >= 0]]].tolist() for row in leaves]


def spans(walked: Walk) -> tuple[Doubles, Doubles]:
    """(rays, boxes) distances at which each ray enters and leaves each box, in float64; a miss has enter > leave."""
    o, d = walked.origins[:, None].astype(float), walked.directions[:, None].astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(walked.lower - o) / d, (walked.upper - o) / d])
    is_within = (walked.lower <= o) & (o <= walked.upper)
    ends[:, np.broadcast_to(d == 0, ends.shape[1:]) & is_within] = np.array([[-np.inf], [np.inf]])
    return np.fmax(ends.min(axis=0).max(axis=2), 0.0), ends.max(axis=0).min(axis=2)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("along_axes", [False, True], ids=["any way", "across an axis"])
@pytest.mark.parametrize("limit", [np.inf, 6.0, 0.0, -0.0])
def test_every_box_that_is_entered_is_shown_once_and_hardly_any_other(
    seed: int, along_axes: bool, limit: float
) -> None:
    walked = random_walk(seed, along_axes)
    near, far = spans(walked)
    sure = (near + ROUNDING < far) & (near + ROUNDING < limit) | ((near == 0) & (far > ROUNDING))
    possible = (near - ROUNDING < far) & (near - ROUNDING < limit)
    for i, boxes in enumerate(shown(walked, np.full(RAYS, limit, np.float32))):
        assert len(set(boxes)) == len(boxes), f"seed {seed}, ray {i}: got {boxes}, expected each once"
        missed = set(np.flatnonzero(sure[i])) - set(boxes)
        others = set(boxes) - set(np.flatnonzero(possible[i]))
        assert not missed, f"seed {seed}, ray {i}: {missed} are entered and not shown"
        assert not others, f"seed {seed}, ray {i}: {others} are shown and not entered"


@pytest.mark.parametrize("seed", range(4))
def test_children_of_a_node_are_shown_nearest_first(seed: int) -> None:
    """Eight boxes, which make a single node."""
    walked = random_walk(seed, along_axes=False)
    eight = walked._replace(lower=walked.lower[:8] * 0.5 - 2.0, upper=walked.upper[:8] * 0.5 + 2.0)
    near, _ = spans(eight)
    for i, boxes in enumerate(shown(eight, np.full(RAYS, np.inf, np.float32))):
        distances = near[i, boxes]
        assert (np.diff(distances) > -ROUNDING).all(), f"seed {seed}, ray {i}: got {distances}, expected no descent"


def test_what_is_below_the_bottom_of_the_stack_is_not_touched() -> None:
    walked, limits = random_walk(0, along_axes=False), np.full(RAYS, np.inf, np.float32)
    assert shown(walked, limits, bottom=OTHERS) == shown(walked, limits)
