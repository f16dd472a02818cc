"""How many entries a traversal's stack needs in a tree."""

import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.trees.nodes import NO_CHILD


def stack_needed(child: NDArray[np.int32]) -> int:
    """The most entries, if each node is popped and all of its children (nodes, 8) are pushed, as on the CPU."""
    room, most = np.ones(len(child), int), 1
    for k, own in enumerate(child):
        full = int(room[k]) - 1 + int((own != NO_CHILD).sum())
        room[own[own >= 0]] = full
        most = max(most, full)
    return most


def stack_needed_by_fours(child: NDArray[np.int32]) -> int:
    """The most entries, if all children (nodes, 4) of a node are pushed but one, with which the traversal goes on."""
    pending, most = np.zeros(len(child), int), 0
    for k, own in enumerate(child):
        full = int(pending[k]) + int((own != NO_CHILD).sum()) - 1
        pending[own[own >= 0]] = full
        most = max(most, full)
    return most
