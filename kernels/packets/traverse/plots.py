"""Tiles through large height fields, whose plots are not stored as nodes.

These fields are visited after all other shapes. A call in the middle of the traversal of the shapes would need
registers set aside for it, which would make the whole traversal 3 to 6 % slower.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.inline import noinline
from rigcast.kernels.packets.intersect.blocks import FEW, visit_block_of_packet
from rigcast.kernels.packets.intersect.frustum import packets_at_box
from rigcast.kernels.packets.intersect.local_packet import LocalPacket, packet_among_triangles
from rigcast.kernels.packets.intersect.slabs import (
    EnteredByLanes,
    enter_any,
    enter_lane_by_lane,
    lanes_at_box,
    slabs_of,
)
from rigcast.kernels.packets.packet import TileRays, view_from
from rigcast.kernels.packets.prefetch import prefetch_block, prefetch_node, prefetch_plot
from rigcast.kernels.poses.scope import is_doubled, is_somewhere, pose_of
from rigcast.kernels.shapes.patches import is_in_plots, open_plot
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, WIDTH, vec8
from rigcast.kernels.vectors import count_bits, lowest_bit, smaller

from .beginning import begin_packets
from .triangles import packet_traversal


@wp.func
def open_plot_of(rays: wp.array[TileRays], k: int) -> None:
    """Make the node of plot k, unless the tile already has it: neighbouring packets often need the same plot."""
    if rays[0].plot != k:
        g = rays[0].geometry
        open_plot(g[0].plots, g[0].sides, k, rays[0].opened)
        rays[0].plot = k


@wp.func
def in_order(patches: int, turned: int) -> int:
    """Permute a bit mask of a plot's patches: bit j moves to j ^ turned. Bits 0 and 1 of `turned` are equal."""
    ordered = patches
    if turned & 3 != 0:
        ordered = ((ordered & 0x55) << 1) | ((ordered >> 1) & 0x55)
        ordered = ((ordered & 0x33) << 2) | ((ordered >> 2) & 0x33)
    if turned & 4 != 0:
        ordered = ((ordered & 0x0F) << 4) | (ordered >> 4)
    return ordered


@wp.func
def visit_plot_of_packet(local: LocalPacket, k: int, lanes: int, reach: float) -> float:
    """Test a packet against the patches of one plot; return its new reach [m]. lanes: those that enter the plot's box.

    Patches are visited front to back. The order follows from the signs of the directions: no ray returns to an earlier
    row or column.
    """
    packet = local.packet
    way = local.way
    open_plot_of(packet.tile, k)
    slabs = slabs_of(packet.tile[0].opened[0], local.view.origin, local.margin, way)
    near_x = slabs.near_x
    near_y = slabs.near_y
    near_z = slabs.near_z
    far_x = slabs.far_x
    far_y = slabs.far_y
    far_z = slabs.far_z
    entered = EnteredByLanes()
    limit = packet.tile[0].limit
    if count_bits(lanes) <= FEW:
        entered = enter_lane_by_lane(slabs, way, packet.best, packet.slot, lanes, limit)
    else:
        entered = enter_any(slabs, way, smaller(reach, limit))
    turned = wp.where(way.high[0] < 0.0, 3, 0) | wp.where(way.high[1] < 0.0, 4, 0)
    patches = in_order(entered.children, turned)
    while patches != 0:
        j = lowest_bit(patches) ^ turned
        patches = patches & (patches - 1)
        start = wp.vec3(near_x[j], near_y[j], near_z[j])
        end = wp.vec3(far_x[j], far_y[j], far_z[j])
        who = lanes & lanes_at_box(way.slowness, packet.best[packet.slot].far, start, end)
        if who != 0:
            reach = visit_block_of_packet(local, FIRST_PATCH + WIDTH * k + j, who, reach)
    return reach


@wp.func
def visit_leaf_of_hfield(local: LocalPacket, index: int, lanes: int, reach: float) -> float:
    """Test a packet against a plot, or against a block of the triangles of the field's sides and bottom."""
    if index >= FIRST_PLOT:
        return visit_plot_of_packet(local, index - FIRST_PLOT, lanes, reach)
    return visit_block_of_packet(local, index, lanes, reach)


@wp.func
def prefetch_child_of_hfield(local: LocalPacket, child: int) -> None:
    if child >= 0:
        prefetch_node(local.nodes, child)
    elif -1 - child >= FIRST_PLOT:
        g = local.packet.tile[0].geometry
        prefetch_plot(g[0].plots, -1 - child - FIRST_PLOT)
    else:
        prefetch_block(local.blocks, -1 - child)


cast_packet_through_hfield = packet_traversal(
    "cast_packet_through_hfield", visit_leaf_of_hfield, prefetch_child_of_hfield
)


@wp.func
def cast_tile_through_hfield(g: Geometry, rays: wp.array[TileRays], shape: int, reach: vec8) -> vec8:
    """Cast a tile against one visible field; return the new reach of each packet [m]."""
    pose = pose_of(rays[0].geometry, shape, rays[0].scope)
    if not is_somewhere(pose) or is_doubled(rays[0].geometry, shape, rays[0].scope):
        return reach
    to_local = wp.transpose(pose.rotation)
    at = rays[0].scope.first_shape + shape
    view = view_from(to_local * (rays[0].origin - pose.position), to_local, rays, g.reach[at])
    tile = rays[0].tile
    packets = packets_at_box(view, tile, g.center[at], g.half[at], reach)
    begin_packets(rays, packets & ~rays[0].met)
    while packets != 0:
        k = lowest_bit(packets)
        packets = packets & (packets - 1)
        local = packet_among_triangles(g, rays, view, k, shape, rays[0].cull)
        reach[k] = cast_packet_through_hfield(local, g.root[at], reach[k])
    return reach


@noinline
def cast_tile_through_hfields(rays: wp.array[TileRays], reach: vec8) -> None:
    """Cast a tile against all visible fields kept in plots. reach: of each packet [m]."""
    g = rays[0].geometry[0]
    scope = rays[0].scope
    for k in range(g.hfields.shape[0]):
        shape = g.hfields[k]
        if is_in_plots(g.hfields, g.columns, scope.first_shape + shape) and g.visible[scope.first_visible + shape]:
            reach = cast_tile_through_hfield(g, rays, shape, reach)
