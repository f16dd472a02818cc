"""Trees over shapes need no deeper stack than there is, also with unbounded shapes and several shapes to a leaf."""

import numpy as np
import pytest
from tree_stacks import stack_needed, stack_needed_by_fours

from rigcast.kernels.trees.fours import boxes_of_leaves, in_fours
from rigcast.kernels.trees.tree import STACK
from rigcast.kernels.world.top_trees import _tree_over


@pytest.mark.parametrize("leaf_size", [1, 8])
@pytest.mark.parametrize("planes", [0, 1, 7, 8])
def test_no_tree_needs_a_deeper_stack_than_there_is(planes: int, leaf_size: int) -> None:
    """Each shape is five times as near as the one before, so that a split leaves all but a few on one side."""
    for count in range(1, 78):
        where = 1e17 * 0.2 ** np.arange(count)[:, None] * np.ones(3)
        unbounded = np.full((planes, 3), np.inf)
        lower = np.concatenate([0.999 * where, -unbounded]).astype(np.float32)
        upper = np.concatenate([1.001 * where, unbounded]).astype(np.float32)
        nodes = _tree_over(lower, upper, np.isfinite(lower[:, 0]), leaf_size)
        child = nodes["child"]
        fours = in_fours(child, *boxes_of_leaves(child, lower, upper))
        assert stack_needed(child) <= STACK, f"{count} shapes"
        assert stack_needed_by_fours(fours["child"]) <= STACK, f"{count} shapes"
