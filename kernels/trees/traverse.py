"""Traversal of a tree with a stack: nearest child first, the others are pushed, sorted by distance."""

from collections.abc import Callable
from typing import Any

import warp as wp

from rigcast.kernels.vectors import lowest_bit

from .nodes import NO_CHILD, Node, vec8, vec8i
from .tree import STACK

stack_of_ints = wp.types.vector(length=STACK, dtype=wp.int32)
stack_of_distances = wp.types.vector(length=STACK, dtype=wp.float32)


@wp.struct
class Entered:
    """The boxes of a node that are entered (bit mask), and the distances [m] at which they are."""

    children: int
    distance: vec8


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    int bits = 0;
    for (int j = 0; j < 8; ++j) bits |= (a[j] < 0) << j;
    return bits;
#else
    typedef int ints __attribute__((ext_vector_type(8)));
    typedef bool bools __attribute__((ext_vector_type(8)));
    ints values;
    __builtin_memcpy(&values, &a, sizeof(values));
    bools negative = __builtin_convertvector(values < 0, bools);
    unsigned char bits;
    __builtin_memcpy(&bits, &negative, sizeof(bits));
    return bits;
#endif
""")
def sign_bits(a: vec8i) -> int:  # type: ignore[empty-body]
    """Bit mask of the numbers below 0, in one instruction that LLVM does not make of a loop."""


@wp.func_native("""
    return wp::address(nodes, at)->child[j];
""")
def child_of(nodes: wp.array[Node], at: int, j: int) -> int:  # type: ignore[empty-body]
    """Child j of node `at`, read alone; Warp would copy all eight first."""


def traversal(
    name: str,
    query_type: type,
    found_type: type,
    enter: Callable[..., Any],
    reach: Callable[..., Any],
    visit: Callable[..., Any],
) -> Any:
    """A Warp function that takes a query through a tree and visits every leaf that may improve its result.

    Args:
        query_type, found_type: types of the query (a ray, bundle or tile) and of its result so far.
        enter: (node, query, distance) -> Entered, the boxes that the query enters no farther than the distance.
        reach: (found) -> distance beyond which nothing can improve the result.
        visit: (geometry, query, leaf, distance of its box, found) -> found.
    """

    def traverse(g: Any, nodes: wp.array[Node], root: int, query: query_type, best: found_type) -> found_type:
        stack = stack_of_ints()
        distances = stack_of_distances()
        top = int(0)
        at = int(root)
        near = float(0.0)
        limit = reach(best)
        while at != NO_CHILD:
            children = int(0)
            if at < 0:
                best = visit(g, query, -1 - at, near, best)
                limit = reach(best)
            else:
                entered = enter(nodes[at], query, limit)
                children = entered.children
            if children != 0:
                distance = entered.distance
                node = int(at)
                j = lowest_bit(children)
                at = child_of(nodes, node, j)
                near = distance[j]
                children = children & (children - 1)
                floor = int(top)
                while children != 0:
                    j = lowest_bit(children)
                    children = children & (children - 1)
                    child = child_of(nodes, node, j)
                    is_nearer = distance[j] < near
                    farther = wp.where(is_nearer, at, child)
                    far = wp.where(is_nearer, near, distance[j])
                    at = wp.where(is_nearer, child, at)
                    near = wp.where(is_nearer, distance[j], near)
                    # insertion sort: entries farther away stay below
                    k = int(top)
                    while k > floor and distances[wp.max(k - 1, 0)] < far:
                        stack[k] = stack[k - 1]
                        distances[k] = distances[k - 1]
                        k -= 1
                    stack[k] = farther
                    distances[k] = far
                    top += 1
            else:
                at = NO_CHILD
                while top > 0 and at == NO_CHILD:
                    top -= 1
                    if distances[top] <= limit:
                        at = stack[top]
                        near = distances[top]
        return best

    traverse.__name__ = traverse.__qualname__ = name
    return wp.func(traverse)
