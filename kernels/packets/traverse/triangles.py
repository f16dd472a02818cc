"""Traversal of a shape's triangle tree by packets.

Each node and leaf is visited with a mask of the lanes that enter its box. If more than FEW lanes enter a node, its
boxes are tested one after the other, each against all lanes at once. Otherwise those lanes are tested one after the
other, each against all eight boxes at once.
"""

from collections.abc import Callable
from typing import Any

import warp as wp

from rigcast.kernels.packets.intersect.blocks import FEW, visit_block_of_packet
from rigcast.kernels.packets.intersect.local_packet import LocalPacket
from rigcast.kernels.packets.intersect.slabs import (
    EnteredByLanes,
    enter_any,
    enter_lane_by_lane,
    lanes_at_box,
    slabs_of,
)
from rigcast.kernels.packets.packet import ALL_LANES
from rigcast.kernels.packets.prefetch import prefetch_block, prefetch_node
from rigcast.kernels.trees.nodes import FIRST_PATCH, NO_CHILD
from rigcast.kernels.trees.traverse import child_of, stack_of_distances, stack_of_ints
from rigcast.kernels.vectors import count_bits, lowest_bit, smaller


def packet_traversal(name: str, visit: Callable[..., Any], prefetch: Callable[..., Any]) -> Any:
    """A Warp function that takes a packet through the tree of a shape and returns its new reach [m].

    The packet descends into the nearest child that any lane enters and pushes the others. The stack is three parallel
    arrays; `top` is its height. The children of one node are sorted as they are pushed, the farthest at the bottom:

        index      stack     distances   lanes
        top - 1    nearest   0.4         0x00f0    popped next, if its distance is within the reach
        ...        ...       0.9         0x0ff0
        floor      farthest  1.7         0x0f00    height at which the node's children begin
        ...                                        children of nodes above, still to be visited

    While the stack is not empty, a leaf that at most FEW lanes enter is deferred, so that its triangles arrive from
    memory in the meantime:

        prefetch leaf A | test node | visit leaf B in place of A, which now waits | ... | visit what waits last

    `waiting` holds one such leaf and `lanes_of_waiting` its lanes. The next such leaf takes its place and the one that
    waited is visited. When the stack runs empty, the waiting leaf is visited.

    Entries of a node's vectors (distances, lanes) are read and written one by one: a vector written by elements and
    then read as a whole would stall on store forwarding. The insertion sort is written out here because Warp passes
    vectors by value: as a function of its own, inlined too, it copies the stack and makes a cast 4 to 21 % slower.

    Args:
        visit: (local, leaf, mask of the lanes that enter its box, reach) -> reach.
        prefetch: (local, child), prefetches a child that will be visited later.
    """

    def traverse(local: LocalPacket, root: int, reach: float) -> float:
        packet = local.packet
        stack = stack_of_ints()
        distances = stack_of_distances()
        lanes = stack_of_ints()
        top = int(0)
        at = int(root)
        entering = int(ALL_LANES)
        waiting = int(NO_CHILD)
        lanes_of_waiting = int(0)
        while at != NO_CHILD:
            if at < 0:
                leaf = int(at)
                who = int(entering)
                if top > 0 and count_bits(entering) <= FEW:
                    leaf = waiting
                    who = lanes_of_waiting
                    waiting = at
                    lanes_of_waiting = entering
                if leaf != NO_CHILD:
                    reach = visit(local, -1 - leaf, who, reach)
                at = int(NO_CHILD)
            else:
                slabs = slabs_of(local.nodes[at], local.view.origin, local.margin, local.way)
                near_x = slabs.near_x
                near_y = slabs.near_y
                near_z = slabs.near_z
                far_x = slabs.far_x
                far_y = slabs.far_y
                far_z = slabs.far_z
                are_few = count_bits(entering) <= FEW
                entered = EnteredByLanes()
                limit = packet.tile[0].limit
                if are_few:
                    entered = enter_lane_by_lane(slabs, local.way, packet.best, packet.slot, entering, limit)
                else:
                    entered = enter_any(slabs, local.way, smaller(reach, limit))
                children = entered.children
                distance = entered.distance
                lanes_of_few = entered.lanes
                node = int(at)
                which = int(entering)
                at = int(NO_CHILD)
                near = float(wp.inf)
                floor = int(top)
                while children != 0:
                    j = lowest_bit(children)
                    children = children & (children - 1)
                    if are_few:
                        who = lanes_of_few[j]
                    else:
                        start = wp.vec3(near_x[j], near_y[j], near_z[j])
                        end = wp.vec3(far_x[j], far_y[j], far_z[j])
                        who = which & lanes_at_box(local.way.slowness, packet.best[packet.slot].far, start, end)
                    if who != 0:
                        child = child_of(local.nodes, node, j)
                        prefetch(local, child)
                        is_nearer = distance[j] < near
                        farther = wp.where(is_nearer, at, child)
                        far = wp.where(is_nearer, near, distance[j])
                        others = wp.where(is_nearer, entering, who)
                        at = wp.where(is_nearer, child, at)
                        near = wp.where(is_nearer, distance[j], near)
                        entering = wp.where(is_nearer, who, entering)
                        if farther != NO_CHILD:
                            # insertion sort: entries farther away stay below
                            k = int(top)
                            while k > floor and distances[wp.max(k - 1, 0)] < far:
                                stack[k] = stack[k - 1]
                                distances[k] = distances[k - 1]
                                lanes[k] = lanes[k - 1]
                                k -= 1
                            stack[k] = farther
                            distances[k] = far
                            lanes[k] = others
                            top += 1
            while top > 0 and at == NO_CHILD:
                top -= 1
                if distances[top] <= reach:
                    at = stack[top]
                    entering = lanes[top]
            if at == NO_CHILD:
                at = waiting
                entering = lanes_of_waiting
                waiting = NO_CHILD
        return reach

    traverse.__name__ = traverse.__qualname__ = name
    return wp.func(traverse)


@wp.func
def prefetch_child(local: LocalPacket, child: int) -> None:
    """Prefetch a node or block. Patches need none: fields whose plots are stored as nodes fit in the cache."""
    if child >= 0:
        prefetch_node(local.nodes, child)
    elif -1 - child < FIRST_PATCH:
        prefetch_block(local.blocks, -1 - child)


cast_packet_through_triangles = packet_traversal("cast_packet_through_triangles", visit_block_of_packet, prefetch_child)
