"""Packets through the triangles of a shape.

Of every node and block is known which rays of the packet enter its box. Many are held against one box, or one triangle,
after the other; a few are taken one by one, each against all boxes of a node or all triangles of a block at once.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits import APART
from rigcast.kernels.traverse import EnteredByLanes, sign_bits, traversal
from rigcast.kernels.trees.nodes import WIDTH, Node, vec8i
from rigcast.kernels.vectors import count_bits, lowest_bit, smaller

from .edges import edges_of, may_be_hit, meet_plane, meet_triangles, pass_edges
from .frustum import boxes_from, enter_frustum, enter_lane_by_lane, lanes_at_box
from .packet import decide_lane_of_packet, farthest, offer
from .prefetch import prefetch_block, prefetch_node
from .sought import Sought

FEW = wp.constant(6)
"""Rays up to which it is faster to take them one by one."""


@wp.func
def visit_block_lane_by_lane(g: Geometry, sought: Sought, index: int, lanes: int, reach: float) -> float:
    """These rays of a packet against the triangles of one block; returns how far all of its rays still reach."""
    at = sought.packet.packet
    slot = sought.packet.slot
    edges = edges_of(g.blocks[index], sought)
    some = int(0)
    while lanes != 0:
        i = lowest_bit(lanes)
        lanes = lanes & (lanes - 1)
        limit = sought.packet.best[slot].far[i] * APART
        p = sought.packet.packets[at].p[i]
        q = sought.packet.packets[at].q[i]
        met = meet_triangles(edges, p, q, sought.packet.packets[at].length[i], sought.cull, limit)
        near = met.near
        far = met.far
        possible = met.possible
        some = some | possible
        while possible != 0:
            j = lowest_bit(possible)
            possible = possible & (possible - 1)
            if far[j] * APART < sought.packet.best[slot].near[i]:
                sought.packet.best[slot].near[i] = near[j]
                sought.packet.best[slot].far[i] = far[j]
                sought.packet.best[slot].shape[i] = sought.shape
                sought.packet.best[slot].triangle[i] = index * WIDTH + j
            elif near[j] <= sought.packet.best[slot].far[i] * APART:
                decide_lane_of_packet(sought.packet, i, near[j], far[j], sought.shape, index * WIDTH + j)
    if some == 0:
        return reach
    return APART * farthest(sought.packet.best[slot].far)


@wp.func
def visit_block_at_once(g: Geometry, sought: Sought, index: int, reach: float) -> float:
    """All rays of a packet against the triangles of one block; returns how far they still reach."""
    edges = edges_of(g.blocks[index], sought)
    at = sought.packet.packet
    length = sought.packet.packets[at].length  # Warp 1.12 takes the field for its function, where it is an argument
    # fields are taken out of their struct first: an element of a field would be a copy of all of it
    side0_a = edges.side0_a
    side0_u = edges.side0_u
    side0_v = edges.side0_v
    side1_a = edges.side1_a
    side1_u = edges.side1_u
    side1_v = edges.side1_v
    side2_a = edges.side2_a
    side2_u = edges.side2_u
    side2_v = edges.side2_v
    slope_a = edges.slope_a
    slope_u = edges.slope_u
    slope_v = edges.slope_v
    rounding = edges.rounding
    height = edges.height
    size = edges.reach
    possible = may_be_hit(edges, sought)
    while possible != 0:
        j = lowest_bit(possible)
        possible = possible & (possible - 1)
        side0 = wp.vec3(side0_a[j], side0_u[j], side0_v[j])
        side1 = wp.vec3(side1_a[j], side1_u[j], side1_v[j])
        side2 = wp.vec3(side2_a[j], side2_u[j], side2_v[j])
        inside = pass_edges(sought.packet.packets[at].p, sought.packet.packets[at].q, side0, side1, side2, rounding[j])
        if inside.some != 0:
            met = meet_plane(
                sought.packet.packets[at].p,
                sought.packet.packets[at].q,
                length,
                inside.by,
                wp.vec3(slope_a[j], slope_u[j], slope_v[j]),
                rounding[j],
                height[j],
                size[j],
                sought.cull,
            )
            reach = offer(sought.packet, met.near, met.far, sought.shape, index * WIDTH + j, reach)
    return reach


@wp.func
def visit_block_of_packet(g: Geometry, sought: Sought, index: int, lanes: int, reach: float) -> float:
    """A packet against the triangles of one block, whose box these rays enter."""
    if count_bits(lanes) <= FEW:
        return visit_block_lane_by_lane(g, sought, index, lanes, reach)
    return visit_block_at_once(g, sought, index, reach)


@wp.func
def prefetch_children(node: Node, sought: Sought, children: int) -> None:
    """Ask for these children of a node."""
    child = node.child
    while children != 0:
        j = lowest_bit(children)
        children = children & (children - 1)
        if child[j] < 0:
            prefetch_block(sought.blocks, -1 - child[j])
        else:
            prefetch_node(sought.nodes, child[j])


@wp.func
def enter_at_once(node: Node, boxes: Node, sought: Sought, lanes: int, reach: float) -> EnteredByLanes:
    """The boxes that these rays of a packet enter, of those that are within its frustum."""
    in_frustum = enter_frustum(node, sought.frustum, smaller(reach, sought.packet.ray.limit))
    center_x = boxes.center_x
    center_y = boxes.center_y
    center_z = boxes.center_z
    half_x = boxes.half_x
    half_y = boxes.half_y
    half_z = boxes.half_z
    entering = vec8i()
    todo = in_frustum.children
    while todo != 0:
        j = lowest_bit(todo)
        todo = todo & (todo - 1)
        entering[j] = lanes & lanes_at_box(
            sought.inverse,
            sought.packet.best[sought.packet.slot].far,
            wp.vec3(center_x[j], center_y[j], center_z[j]),
            wp.vec3(half_x[j], half_y[j], half_z[j]),
        )
    entered = EnteredByLanes()
    entered.children = sign_bits(-entering)
    entered.distance = in_frustum.distance
    entered.lanes = entering
    prefetch_children(node, sought, entered.children)
    return entered


@wp.func
def enter_of_packet(node: Node, sought: Sought, lanes: int, reach: float) -> EnteredByLanes:
    """The boxes that some of these rays of the packet enter."""
    boxes = boxes_from(node, sought.view, sought.widest)
    if count_bits(lanes) <= FEW:
        entered = enter_lane_by_lane(
            boxes, sought.inverse, sought.packet.best, sought.packet.slot, lanes, sought.packet.ray.limit
        )
        prefetch_children(node, sought, entered.children)
        return entered
    return enter_at_once(node, boxes, sought, lanes, reach)


@wp.func
def reach_of_packet(reach: float) -> float:
    return reach


cast_packet_through_triangles = traversal(
    "cast_packet_through_triangles",
    Sought,
    float,
    enter_of_packet,
    reach_of_packet,
    visit_block_of_packet,
    by_lanes=True,
)
