"""Trees hold every box once, enclose what they hold, and never need a deeper stack than STACK."""

import numpy as np
import pytest
from boxes_to_build import ADVERSARIAL, ALL, Boxes, boxes_around, scattered
from numpy.typing import NDArray
from tree_stacks import stack_needed

from rigcast.kernels.trees import tree
from rigcast.kernels.trees.nodes import NO_CHILD, join_trees, moved_nodes
from rigcast.kernels.trees.tree import STACK, Tree, build_tree


@pytest.fixture(params=[tree.LARGE, 1], ids=["one round", "two rounds"])
def rounds(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Build these small trees in one round, and in two as large ones."""
    monkeypatch.setattr(tree, "LARGE", request.param)


def present(node: np.void) -> NDArray[np.int32]:
    """Indices of a node's children that are not absent."""
    return np.flatnonzero(node["child"] != NO_CHILD).astype(np.int32)


def extent(built: Tree, boxes: Boxes, k: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exact bounds of leaf ~k (k < 0) or of node k, children first."""
    if k < 0:
        first, count = built.leaf_first[~k], built.leaf_count[~k]
        held = built.order[first : first + count]
        return boxes[0][held].min(axis=0).astype(np.float64), boxes[1][held].max(axis=0).astype(np.float64)
    children = [extent(built, boxes, int(c)) for c in built.nodes[k]["child"][present(built.nodes[k])]]
    lower, upper = (np.stack(corners) for corners in zip(*children, strict=True))
    return lower.min(axis=0), upper.max(axis=0)


@pytest.mark.usefixtures("rounds")
@pytest.mark.parametrize("leaf_size", [1, 4, 8])
@pytest.mark.parametrize("name", ALL)
def test_every_box_is_in_exactly_one_leaf_and_every_leaf_and_node_in_one_parent(name: str, leaf_size: int) -> None:
    lower, upper = ALL[name]
    built = build_tree(lower, upper, leaf_size)
    leaves = [built.order[f : f + c] for f, c in zip(built.leaf_first, built.leaf_count, strict=True)]
    np.testing.assert_array_equal(np.sort(np.concatenate(leaves)), np.arange(len(lower)))
    assert built.leaf_count.min() >= 1
    assert built.leaf_count.max() <= leaf_size
    children = built.nodes["child"][built.nodes["child"] != NO_CHILD]
    np.testing.assert_array_equal(np.sort(children[children >= 0]), np.arange(1, len(built.nodes)))
    np.testing.assert_array_equal(np.sort(~children[children < 0]), np.arange(len(leaves)))


@pytest.mark.usefixtures("rounds")
@pytest.mark.parametrize("name", ALL)
def test_children_come_after_their_parents(name: str) -> None:
    built = build_tree(*ALL[name], leaf_size=1)
    child = built.nodes["child"]
    parent = np.broadcast_to(np.arange(len(child))[:, None], child.shape)
    assert (child > parent)[child >= 0].all()


@pytest.mark.parametrize("leaf_size", [1, 8])
@pytest.mark.parametrize("name", ALL)
def test_boxes_enclose_what_is_under_them_and_little_more(name: str, leaf_size: int) -> None:
    boxes = ALL[name]
    built = build_tree(*boxes, leaf_size)
    for node in built.nodes:
        for j in present(node):
            low, high = extent(built, boxes, int(node["child"][j]))
            middle, half = (np.array([node[f"{part}_{a}"][j] for a in "xyz"], float) for part in ("center", "half"))
            # by no more than the two roundings of middle +- half in float32
            size = np.maximum(np.abs(low), np.abs(high))
            assert (middle - half <= low).all(), f"{name}: {middle} - {half} > {low}"
            assert (middle + half >= high).all(), f"{name}: {middle} + {half} < {high}"
            assert (half - (high - low) / 2 <= 2e-6 * size).all(), f"{name}: {half} is more than {(high - low) / 2}"


@pytest.mark.parametrize("name", ALL)
def test_absent_children_have_a_box_that_no_ray_meets(name: str) -> None:
    built = build_tree(*ALL[name], leaf_size=1)
    absent = built.nodes["child"] == NO_CHILD
    for axis in "xyz":
        assert (built.nodes[f"half_{axis}"][absent] == -np.inf).all()
        assert np.isfinite(built.nodes[f"half_{axis}"][~absent]).all()


@pytest.mark.usefixtures("rounds")
@pytest.mark.parametrize("name", ALL)
def test_no_tree_needs_a_deeper_stack_than_there_is(name: str) -> None:
    assert stack_needed(build_tree(*ALL[name], leaf_size=1).nodes["child"]) <= STACK


@pytest.mark.parametrize("name", ADVERSARIAL)
def test_the_heuristic_alone_would_need_a_deeper_stack(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the test above would not show that such trees are balanced instead."""
    monkeypatch.setattr(tree, "STACK", 10**6)
    assert stack_needed(build_tree(*ALL[name], leaf_size=1).nodes["child"]) > STACK


@pytest.mark.parametrize("count", [1, 3, 7, 8, 9, 70])
@pytest.mark.parametrize("others", [1, 2, 7, 8, 9, 70])
def test_joined_trees_hold_the_leaves_of_both(count: int, others: int) -> None:
    a = build_tree(*scattered(count), leaf_size=1).nodes
    b = moved_nodes(build_tree(*scattered(others), leaf_size=1).nodes, 0, count)
    child = join_trees(a, b)["child"]
    parent = np.broadcast_to(np.arange(len(child))[:, None], child.shape)
    children = child[child != NO_CHILD]
    assert (child > parent)[child >= 0].all()
    np.testing.assert_array_equal(np.sort(children[children >= 0]), np.arange(1, len(child)))
    np.testing.assert_array_equal(np.sort(~children[children < 0]), np.arange(count + others))


def test_what_joins_a_full_root_hangs_from_it_and_the_smallest_make_room() -> None:
    lower, upper = boxes_around(10.0 * np.arange(8)[:, None] * np.ones(3), np.arange(8, 0, -1)[:, None] / 2)
    a = build_tree(lower, upper, leaf_size=1)
    root, below = join_trees(a.nodes, moved_nodes(build_tree(*scattered(2), leaf_size=1).nodes, 0, 8))["child"]
    held = {(leaf if leaf >= 8 else int(a.order[a.leaf_first[leaf]])) for leaf in (~root[root < 0]).tolist()}
    assert held == {8, 9, 0, 1, 2, 3, 4}
    assert root[root >= 0].tolist() == [1]
    assert (below != NO_CHILD).sum() == 3


def test_no_thread_count_changes_a_bit_of_a_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    boxes = scattered(2 * tree.LARGE)
    built = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("RIGCAST_THREADS", threads)
        got = build_tree(*boxes, leaf_size=8)
        built.append([a.tobytes() for a in (got.nodes, got.order, got.leaf_first, got.leaf_count)])
    assert built[0] == built[1] == built[2]


def test_leaves_are_filled() -> None:
    """The cost of a leaf does not depend on how full it is."""
    assert build_tree(*scattered(8000), leaf_size=8).leaf_count.mean() > 7


def test_no_boxes_give_a_root_without_children() -> None:
    built = build_tree(*scattered(0), leaf_size=8)
    assert len(built.nodes) == 1
    assert (built.nodes["child"] == NO_CHILD).all()
    assert (built.nodes["half_x"] == -np.inf).all()
    assert len(built.order) == len(built.leaf_first) == len(built.leaf_count) == 0


@pytest.mark.parametrize(("count", "leaves"), [(1, 1), (8, 1), (9, 2)])
def test_a_leaf_is_split_only_when_it_is_too_full(count: int, leaves: int) -> None:
    built = build_tree(*scattered(count), leaf_size=8)
    assert (len(built.nodes), len(built.leaf_count)) == (1, leaves)


def test_boxes_are_not_changed_by_the_build() -> None:
    lower, upper = scattered(100)
    before = lower.copy(), upper.copy()
    build_tree(lower, upper, leaf_size=1)
    np.testing.assert_array_equal((lower, upper), before)


def cost(built: Tree) -> float:
    """The surface-area heuristic: expected nodes and boxes that a random line through the root's box is tested with."""
    x, y, z = (2 * built.nodes[f"half_{axis}"].astype(np.float64) for axis in "xyz")
    area = np.where(built.nodes["child"] != NO_CHILD, x * y + y * z + z * x, 0.0)
    child = built.nodes["child"]
    leaf_size = np.where(child < 0, built.leaf_count[np.where(child < 0, ~child, 0) % len(built.leaf_count)], 1)
    return float((area * leaf_size).sum())


@pytest.mark.parametrize(("name", "gain"), [("clustered", 5), ("1000 scattered", 2)])
def test_the_heuristic_beats_halving_by_count(name: str, gain: float, monkeypatch: pytest.MonkeyPatch) -> None:
    by_area = cost(build_tree(*ALL[name], leaf_size=4))
    monkeypatch.setattr(tree, "STACK", 0)
    by_count = cost(build_tree(*ALL[name], leaf_size=4))
    assert gain * by_area < by_count, f"got a cost of {by_area:.4g}, halving by count costs {by_count:.4g}"
