"""Trees in fours hold the leaves of the trees in eights, in boxes around them, and need no deeper stack than STACK."""

import numpy as np
import pytest
from boxes_to_build import ALL, Boxes
from numpy.typing import NDArray
from tree_stacks import stack_needed_by_fours

from rigcast.kernels.trees.fours import boxes_of_leaves, in_fours, levels_of, moved_fours
from rigcast.kernels.trees.nodes import NO_CHILD, empty_nodes, ends_of
from rigcast.kernels.trees.tree import STACK, build_tree


def fours_over(boxes: Boxes) -> NDArray[np.void]:
    """The tree over the boxes; leaf ~k is box k."""
    built = build_tree(*boxes, leaf_size=1)
    child = built.nodes["child"]
    is_leaf = (child < 0) & (child != NO_CHILD)
    child[is_leaf] = ~built.order[built.leaf_first[~child[is_leaf]]]
    return in_fours(child, *boxes_of_leaves(child, *boxes))


def ends(fours: NDArray[np.void]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The lower and upper ends (n, 4, 3) of the children's boxes."""
    lower, upper = (np.stack([fours[f"{end}_{axis}"] for axis in "xyz"], axis=-1) for end in ("lower", "upper"))
    return lower, upper


@pytest.mark.parametrize("name", ALL)
def test_every_box_is_one_leaf_as_it_is_and_every_node_has_one_parent_before_it(name: str) -> None:
    fours = fours_over(ALL[name])
    child = fours["child"]
    is_leaf = (child < 0) & (child != NO_CHILD)
    np.testing.assert_array_equal(np.sort(~child[is_leaf]), np.arange(len(ALL[name][0])))
    for got, expected in zip(ends(fours), ALL[name], strict=True):
        np.testing.assert_array_equal(got[is_leaf], expected[~child[is_leaf]])
    np.testing.assert_array_equal(child[child >= 0], np.arange(1, len(fours)))


@pytest.mark.parametrize("name", ALL)
def test_boxes_of_nodes_are_the_smallest_around_what_they_hold(name: str) -> None:
    fours = fours_over(ALL[name])
    lower, upper = ends(fours)
    inner = np.nonzero(fours["child"] >= 0)
    below = fours["child"][inner]
    np.testing.assert_array_equal(lower[inner], lower[below].min(axis=1))
    np.testing.assert_array_equal(upper[inner], upper[below].max(axis=1))


@pytest.mark.parametrize("name", ALL)
def test_no_tree_in_fours_needs_a_deeper_stack_than_there_is(name: str) -> None:
    assert stack_needed_by_fours(fours_over(ALL[name])["child"]) <= STACK


def test_pairs_beside_a_long_path_are_opened_only_while_the_stack_has_room() -> None:
    """Each node of the path has one large child with three leaves. If this was always opened, each would leave three
    entries on the stack."""
    path = 60
    assert 3 * path > STACK
    nodes = empty_nodes(2 * path)
    lower, upper = (np.zeros((len(nodes), 8, 3), np.float32) for _ in range(2))
    nodes["child"][:path, 0], nodes["child"][:path, 1] = 1 + np.arange(path), path + np.arange(path)
    nodes["child"][path - 1, 0] = ~(3 * path)
    nodes["child"][path:, :3] = ~np.arange(3 * path).reshape(-1, 3)
    upper[path:, :3] = (0.8 ** np.arange(path))[:, None, None] * np.array([1.0, 2.0, 3.0])[:, None]
    upper[path - 1, 0] = 0.1 * 0.8**path
    fours = in_fours(nodes["child"], lower, upper)
    child = fours["child"]
    np.testing.assert_array_equal(np.sort(~child[(child < 0) & (child != NO_CHILD)]), np.arange(3 * path + 1))
    assert path < stack_needed_by_fours(child) <= STACK


@pytest.mark.parametrize("name", ALL)
def test_there_are_at_most_two_nodes_for_three_leaves(name: str) -> None:
    """So that many worlds' trees over shapes take no more memory than in eights; none of these needs a short stack."""
    lower, _upper = ALL[name]
    assert len(fours_over(ALL[name])) <= max(1, 2 * len(lower) / 3)


def test_nodes_above_others_are_full() -> None:
    child = fours_over(ALL["1000 scattered"])["child"]
    assert (child[(child >= 0).any(axis=1)] != NO_CHILD).all()


def test_levels_are_the_generations_of_the_root() -> None:
    fours = fours_over(ALL["1000 scattered"])
    levels = levels_of(fours)
    assert levels[:2] == [0, 1]
    assert levels[-1] == len(fours)
    for begin, end, after in zip(levels, levels[1:], levels[2:], strict=False):
        child = fours["child"][begin:end]
        np.testing.assert_array_equal(child[child >= 0], np.arange(end, after))


def test_a_tree_without_leaves_is_one_node_without_children() -> None:
    nodes = empty_nodes(1)
    (root,) = in_fours(nodes["child"], *ends_of(nodes))
    assert (root["child"] == NO_CHILD).all()
    assert (root["lower_x"] == np.inf).all()
    assert (root["upper_z"] == -np.inf).all()


def root_over(lower: NDArray[np.float32], upper: NDArray[np.float32]) -> NDArray[np.void]:
    """The tree made of one node of eight over these boxes."""
    nodes = empty_nodes(1)
    nodes["child"][0, : len(lower)] = ~np.arange(len(lower))
    return in_fours(nodes["child"], *boxes_of_leaves(nodes["child"], lower, upper))


UNBOUNDED = {
    "everywhere": ((-np.inf, -np.inf, -np.inf), (np.inf, np.inf, np.inf)),
    "nowhere": ((np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)),
    "a flat floor": ((-np.inf, -np.inf, 0.0), (np.inf, np.inf, 0.0)),
}


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("name", UNBOUNDED)
def test_boxes_that_are_unbounded_or_empty_are_kept(name: str, count: int) -> None:
    lower, upper = (np.tile(np.array(end, np.float32), (count, 1)) for end in UNBOUNDED[name])
    (root,) = root_over(lower, upper)
    order = ~root["child"][:count]
    assert sorted(order) == list(range(count))
    for axis in range(3):
        np.testing.assert_array_equal(root[f"lower_{'xyz'[axis]}"][:count], lower[order, axis])
        np.testing.assert_array_equal(root[f"upper_{'xyz'[axis]}"][:count], upper[order, axis])


def test_neighbours_come_under_one_node() -> None:
    """Two places, with every second box in the other."""
    lower = np.arange(8)[:, None] % 2 * 100 + np.arange(8)[:, None] * np.ones(3)
    _root, *below = root_over(lower.astype(np.float32), lower.astype(np.float32) + 1)["child"]
    places = [set((~child[child != NO_CHILD] % 2).tolist()) for child in below]
    assert sorted(places, key=min) == [{0}, {0}, {1}, {1}]


def test_moved_nodes_lead_to_the_same_leaves() -> None:
    fours = fours_over(ALL["65 scattered"])
    moved = moved_fours(fours, 10)["child"]
    is_node = fours["child"] >= 0
    np.testing.assert_array_equal(moved[is_node], fours["child"][is_node] + 10)
    np.testing.assert_array_equal(moved[~is_node], fours["child"][~is_node])
