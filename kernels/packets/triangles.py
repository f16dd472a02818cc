"""Packets through the triangles of a shape.

Of every node and block is known which rays of the packet enter its box. Many are held against one box, or one triangle,
after the other; a few are taken one by one, each against all boxes of a node or all triangles of a block at once.
"""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock
from rigcast.kernels.hits.hit import APART
from rigcast.kernels.shapes.patches import compose, open_plot
from rigcast.kernels.single.traverse import child_among_triangles, stack_of_distances, stack_of_ints
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, NO_CHILD, WIDTH, Node, vec8
from rigcast.kernels.vectors import count_bits, lowest_bit, smaller

from .edges import edges_of, may_be_hit, meet_plane, meet_triangles, pass_edges
from .lanes import direction_of, far_of, near_of
from .packet import ALL_LANES, TileRays, decide_lane_of_packet, farthest, offer
from .prefetch import prefetch_block, prefetch_node, prefetch_plot
from .slabs import EnteredByLanes, enter_any, enter_lane_by_lane, lanes_at_box, slabs_of
from .sought import Sought

FEW = wp.constant(6)
"""Rays up to which it is faster to take them one by one."""


@wp.func
def visit_block_lane_by_lane(
    sought: Sought, index: int, lanes: int, reach: float, blocks: wp.array[TriangleBlock], block: int
) -> float:
    """These rays of a packet against the triangles of one block; returns how far all of its rays still reach."""
    best = sought.packet.best
    slot = sought.packet.slot
    edges = edges_of(blocks[block], sought.view, sought.side_rounding)
    some = int(0)
    while lanes != 0:
        i = lowest_bit(lanes)
        lanes = lanes & (lanes - 1)
        limit = far_of(best, slot, i) * APART
        met = meet_triangles(edges, direction_of(sought.local, i), sought.cull, limit)
        near = met.near
        far = met.far
        possible = met.possible
        some = some | possible
        while possible != 0:
            j = lowest_bit(possible)
            possible = possible & (possible - 1)
            if far[j] * APART < near_of(best, slot, i):
                best[slot].near[i] = near[j]
                best[slot].far[i] = far[j]
                best[slot].shape[i] = sought.shape
                best[slot].triangle[i] = index * WIDTH + j
            elif near[j] <= far_of(best, slot, i) * APART:
                decide_lane_of_packet(sought.packet.tile, slot, i, near[j], far[j], sought.shape, index * WIDTH + j)
    if some == 0:
        return reach
    return APART * farthest(sought.packet.best[slot].far)


@wp.func
def visit_block_at_once(sought: Sought, index: int, reach: float, blocks: wp.array[TriangleBlock], block: int) -> float:
    """All rays of a packet against the triangles of one block; returns how far they still reach."""
    edges = edges_of(blocks[block], sought.view, sought.side_rounding)
    # fields are taken out of their struct first: an element of a field would be a copy of all of it
    side0_of = edges.side0
    side1_of = edges.side1
    side2_of = edges.side2
    normal_of = edges.normal
    rounding = edges.rounding
    height = edges.height
    size = edges.size
    possible = may_be_hit(edges, sought.middle, sought.spread, sought.widest)
    while possible != 0:
        j = lowest_bit(possible)
        possible = possible & (possible - 1)
        side0 = wp.vec3(side0_of[0, j], side0_of[1, j], side0_of[2, j])
        side1 = wp.vec3(side1_of[0, j], side1_of[1, j], side1_of[2, j])
        side2 = wp.vec3(side2_of[0, j], side2_of[1, j], side2_of[2, j])
        inside = pass_edges(sought.local[0].x, sought.local[0].y, sought.local[0].z, side0, side1, side2, rounding[j])
        if inside.some != 0:
            met = meet_plane(
                sought.local[0].x,
                sought.local[0].y,
                sought.local[0].z,
                inside.by,
                wp.vec3(normal_of[0, j], normal_of[1, j], normal_of[2, j]),
                rounding[j],
                height[j],
                size[j],
                sought.cull,
            )
            reach = offer(sought.packet, met.near, met.far, sought.shape, index * WIDTH + j, reach)
    return reach


@wp.func
def compose_patch(rays: wp.array[TileRays], k: int) -> None:
    """Make the triangles of patch k, unless they are there."""
    if rays[0].patch != k:
        g = rays[0].geometry
        compose(g[0].plots, g[0].sides, k, rays[0].composed)
        rays[0].patch = k


@wp.func
def open_plot_of(rays: wp.array[TileRays], k: int) -> None:
    """Make the node that plot k is, unless it is there."""
    if rays[0].plot != k:
        g = rays[0].geometry
        open_plot(g[0].plots, g[0].sides, k, rays[0].opened)
        rays[0].plot = k


@wp.func
def visit_block_of_packet(sought: Sought, index: int, lanes: int, reach: float) -> float:
    """A packet against the triangles of one leaf, whose box these rays enter."""
    blocks = sought.blocks
    block = int(index)
    if index >= FIRST_PATCH:
        compose_patch(sought.packet.tile, index - FIRST_PATCH)
        blocks = sought.packet.tile[0].composed
        block = 0
    if count_bits(lanes) <= FEW:
        return visit_block_lane_by_lane(sought, index, lanes, reach, blocks, block)
    return visit_block_at_once(sought, index, reach, blocks, block)


@wp.func
def prefetch_child(sought: Sought, child: int) -> None:
    """Of a patch there is nothing to ask for: its plot has been opened."""
    if child >= FIRST_PLOT:
        g = sought.packet.tile[0].geometry
        prefetch_plot(g[0].plots, child - FIRST_PLOT)
    elif child >= 0:
        prefetch_node(sought.nodes, child)
    elif -1 - child < FIRST_PATCH:
        prefetch_block(sought.blocks, -1 - child)


def _of_node(name: str) -> str:
    """Of C++, that reads one field."""
    return f"return (at < {int(FIRST_PLOT)} ? &nodes.data[at] : &opened.data[0])->{name};"


@wp.func_native(_of_node("center_x"))
def center_x_of(nodes: wp.array[Node], opened: wp.array[Node], at: int) -> vec8:
    """Of a stored node, or of the plot that is opened."""


@wp.func_native(_of_node("center_y"))
def center_y_of(nodes: wp.array[Node], opened: wp.array[Node], at: int) -> vec8:
    """Of a stored node, or of the plot that is opened."""


@wp.func_native(_of_node("center_z"))
def center_z_of(nodes: wp.array[Node], opened: wp.array[Node], at: int) -> vec8:
    """Of a stored node, or of the plot that is opened."""


@wp.func_native(_of_node("half_x"))
def half_x_of(nodes: wp.array[Node], opened: wp.array[Node], at: int) -> vec8:
    """Of a stored node, or of the plot that is opened."""


@wp.func_native(_of_node("half_y"))
def half_y_of(nodes: wp.array[Node], opened: wp.array[Node], at: int) -> vec8:
    """Of a stored node, or of the plot that is opened."""


@wp.func_native(_of_node("half_z"))
def half_z_of(nodes: wp.array[Node], opened: wp.array[Node], at: int) -> vec8:
    """Of a stored node, or of the plot that is opened."""


@wp.func
def node_at(nodes: wp.array[Node], opened: wp.array[Node], at: int) -> Node:
    """The boxes of a node. Either is read in one place, as code is long already."""
    node = Node()
    node.center_x = center_x_of(nodes, opened, at)
    node.center_y = center_y_of(nodes, opened, at)
    node.center_z = center_z_of(nodes, opened, at)
    node.half_x = half_x_of(nodes, opened, at)
    node.half_y = half_y_of(nodes, opened, at)
    node.half_z = half_z_of(nodes, opened, at)
    return node


@wp.func
def cast_packet_through_triangles(sought: Sought, root: int, reach: float) -> float:
    """A packet through the tree of a shape; returns how far its rays still reach.

    As rigcast.kernels.single.traverse, but that of every box is known which rays enter it. What belongs to a box is
    read and written one by one: vectors that are written so and then read as a whole wait for each other in memory.
    """
    packet = sought.packet
    stack = stack_of_ints()
    distances = stack_of_distances()
    lanes = stack_of_ints()
    top = int(0)
    at = int(root)
    entering = int(ALL_LANES)
    # a block or plot that few rays enter waits for the next one, and meanwhile comes from memory
    waiting = int(NO_CHILD)
    lanes_of_waiting = int(0)
    while at != NO_CHILD:
        if at >= FIRST_PLOT:  # noqa: SIM102, as Warp evaluates both sides of an `and`
            if top > 0 and count_bits(entering) <= FEW and (waiting == NO_CHILD or waiting >= FIRST_PLOT):
                plot = int(waiting)
                its_lanes = int(lanes_of_waiting)
                waiting = at
                lanes_of_waiting = entering
                at = plot
                entering = its_lanes
        if at < 0:
            leaf = int(at)
            who = int(entering)
            if top > 0 and count_bits(entering) <= FEW and -1 - at < FIRST_PATCH and waiting < 0:
                leaf = waiting
                who = lanes_of_waiting
                waiting = at
                lanes_of_waiting = entering
            if leaf != NO_CHILD:
                reach = visit_block_of_packet(sought, -1 - leaf, who, reach)
            at = int(NO_CHILD)
        else:
            if at >= FIRST_PLOT:
                open_plot_of(packet.tile, at - FIRST_PLOT)
            boxes = node_at(sought.nodes, packet.tile[0].opened, at)
            slabs = slabs_of(boxes, sought.view.origin, sought.margin, sought.way)
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
                entered = enter_lane_by_lane(slabs, sought.way, packet.best, packet.slot, entering, limit)
            else:
                entered = enter_any(slabs, sought.way, smaller(reach, limit))
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
                    who = which & lanes_at_box(sought.way.slowness, packet.best[packet.slot].far, start, end)
                if who != 0:
                    child = child_among_triangles(sought.nodes, node, j)
                    prefetch_child(sought, child)
                    is_nearer = distance[j] < near
                    farther = wp.where(is_nearer, at, child)
                    far = wp.where(is_nearer, near, distance[j])
                    others = wp.where(is_nearer, entering, who)
                    at = wp.where(is_nearer, child, at)
                    near = wp.where(is_nearer, distance[j], near)
                    entering = wp.where(is_nearer, who, entering)
                    if farther != NO_CHILD:
                        # insert where those farther still are below
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
