"""Packets through the triangles of a shape."""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.traverse import Entered, traversal
from rigcast.kernels.trees.nodes import WIDTH, Node
from rigcast.kernels.vectors import lowest_bit, smaller

from .edges import edges_of, meet_plane, pass_edges
from .frustum import boxes_from, enter_frustum, some_lane_enters
from .packet import offer
from .prefetch import prefetch_block, prefetch_node
from .sought import Sought


@wp.func
def visit_block_of_packet(g: Geometry, sought: Sought, index: int, distance: float, reach: float) -> float:  # noqa: ARG001
    """A packet against the triangles of one block; returns how far its rays still reach."""
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
    possible = edges.possible
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
def enter_of_packet(node: Node, sought: Sought, reach: float) -> Entered:
    """The boxes that some ray of the packet enters."""
    entered = enter_frustum(node, sought.frustum, smaller(reach, sought.packet.ray.limit))
    widest = 1.0 + wp.abs(sought.p) + sought.p_half + wp.abs(sought.q) + sought.q_half
    boxes = boxes_from(node, sought.view, widest)
    center_x = boxes.center_x
    center_y = boxes.center_y
    center_z = boxes.center_z
    half_x = boxes.half_x
    half_y = boxes.half_y
    half_z = boxes.half_z
    child = boxes.child
    todo = entered.children
    while todo != 0:
        j = lowest_bit(todo)
        todo = todo & (todo - 1)
        some = some_lane_enters(
            sought.inverse,
            sought.packet.best[sought.packet.slot].far,
            wp.vec3(center_x[j], center_y[j], center_z[j]),
            wp.vec3(half_x[j], half_y[j], half_z[j]),
        )
        if some == 0:
            entered.children = entered.children & ~(1 << j)
        elif child[j] < 0:
            prefetch_block(sought.blocks, -1 - child[j])
        else:
            prefetch_node(sought.nodes, child[j])
    return entered


@wp.func
def reach_of_packet(reach: float) -> float:
    return reach


cast_packet_through_triangles = traversal(
    "cast_packet_through_triangles", Sought, float, enter_of_packet, reach_of_packet, visit_block_of_packet
)
