"""The walk through a tree, nearest boxes first, with a stack."""

from collections.abc import Callable
from typing import Any

import warp as wp

from .geometry import Geometry
from .tree import STACK, Node, vec8
from .vectors import lowest_bit

stack_of_nodes = wp.types.vector(length=STACK, dtype=wp.int32)
stack_of_distances = wp.types.vector(length=STACK, dtype=wp.float32)


@wp.struct
class Entered:
    """Which boxes of a node are entered, bit by bit, and at what distances."""

    children: int
    distance: vec8


def traversal(
    name: str, query: type, found: type, enter: Callable[..., Any], reach: Callable[..., Any], visit: Callable[..., Any]
) -> Any:
    """A Warp function that takes a query through a tree and shows it every leaf that may hold something better.

    Args:
        query, found: types of what is sought, and of what has been found so far.
        enter: (node, query, distance) -> Entered, the boxes that the query enters no farther than the distance.
        reach: (found) -> distance beyond which nothing better can be.
        visit: (geometry, query, leaf, distance of its box, found) -> found.
    """

    def traverse(g: Geometry, nodes: wp.array[Node], root: int, sought: query, best: found) -> found:
        stack = stack_of_nodes()
        distance = stack_of_distances()
        stack[0] = root
        top = int(1)
        while top > 0:
            top -= 1
            at = stack[top]
            if distance[top] <= reach(best):
                if at < 0:
                    best = visit(g, sought, -1 - at, distance[top], best)
                else:
                    entered = enter(nodes[at], sought, reach(best))
                    children = entered.children
                    away = entered.distance
                    child = nodes[at].child
                    floor = top
                    while children != 0:
                        j = lowest_bit(children)
                        children = children & (children - 1)
                        # insert where the farther ones are below
                        k = int(top)
                        while k > floor and distance[wp.max(k - 1, 0)] < away[j]:
                            distance[k] = distance[k - 1]
                            stack[k] = stack[k - 1]
                            k -= 1
                        distance[k] = away[j]
                        stack[k] = child[j]
                        top += 1
        return best

    traverse.__name__ = traverse.__qualname__ = name
    return wp.func(traverse)
