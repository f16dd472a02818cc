"""Traversal of the tree over the shapes by whole tiles."""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.packets.intersect.frustum import Frustum, boxes_from, enter_frustum, frustum_of, packets_at_box
from rigcast.kernels.packets.intersect.local_packet import packet_among_triangles
from rigcast.kernels.packets.intersect.solids import triage_closed_forms
from rigcast.kernels.packets.packet import (
    LANES,
    PACKETS,
    TileRays,
    View,
    double_lanes,
    offer,
    packet_of,
    round_vectors,
    view_from,
)
from rigcast.kernels.poses.scope import is_doubled, pose_of
from rigcast.kernels.shapes.patches import is_in_plots
from rigcast.kernels.shapes.solids import SHEET, has_triangles
from rigcast.kernels.shapes.triangle import CULL_FRONT, CULL_NONE
from rigcast.kernels.trees.nodes import Node, vec8
from rigcast.kernels.trees.traverse import Entered, traversal
from rigcast.kernels.vectors import larger, lowest_bit, smaller

from .beginning import begin_packets
from .plots import cast_tile_through_hfields
from .triangles import cast_packet_through_triangles


@wp.struct
class LocalTile:
    """A tile of rays, with its frustum in the frame of the tree over the shapes. view: origin and basis there."""

    rays: wp.array[TileRays]
    frustum: Frustum
    view: View


@wp.func
def visit_closed_form(
    g: Geometry,
    rays: wp.array[TileRays],
    k: int,
    shape: int,
    to_local: wp.mat33d,
    origin: wp.vec3,
    reach: float,
) -> float:
    """Test packet k of a tile against one closed form, each lane as a single ray would be; return its new reach [m]."""
    slot = rays[0].first_slot + k
    x = rays[0].directions[slot].x
    y = rays[0].directions[slot].y
    z = rays[0].directions[slot].z
    local_x = double_lanes()
    local_y = double_lanes()
    local_z = double_lanes()
    for i in range(LANES):
        d = to_local * wp.vec3d(x[i], y[i], z[i])
        local_x[i] = d[0]
        local_y[i] = d[1]
        local_z[i] = d[2]
    local = rays[0].local
    round_vectors(local, local_x, local_y, local_z)
    size = g.size[rays[0].scope.first_shape + shape]
    spans = triage_closed_forms(g.kind[shape], size, origin, local[0], rays[0].cull)
    return offer(packet_of(rays, k), spans.near, spans.far, shape, 0, reach)


@wp.func
def visit_shape_of_tile(g: Geometry, tile: LocalTile, shape: int, distance: float, reach: vec8) -> vec8:  # noqa: ARG001
    """Cast a tile against one shape, if it is visible; return the new reach of each packet [m]."""
    rays = tile.rays
    kind = g.kind[shape]
    scope = rays[0].scope
    at = scope.first_shape + shape
    if not g.visible[scope.first_visible + shape] or (kind == SHEET and rays[0].cull == CULL_FRONT):
        return reach
    if is_in_plots(g.hfields, g.columns, at) or is_doubled(rays[0].geometry, shape, scope):
        return reach
    pose = pose_of(rays[0].geometry, shape, scope)
    to_local = wp.transpose(pose.rotation)
    view = view_from(to_local * (rays[0].origin - pose.position), to_local, rays, g.reach[at])
    packets = packets_at_box(view, rays[0].tile, g.center[at], g.half[at], reach)
    begin_packets(rays, packets & ~rays[0].met)
    cull = wp.where(kind == SHEET, CULL_NONE, rays[0].cull)
    while packets != 0:
        k = lowest_bit(packets)
        packets = packets & (packets - 1)
        if has_triangles(kind):
            local = packet_among_triangles(g, rays, view, k, shape, cull)
            reach[k] = cast_packet_through_triangles(local, g.root[at], reach[k])
        else:
            reach[k] = visit_closed_form(g, rays, k, shape, to_local, view.origin, reach[k])
    return reach


@wp.func
def enter_of_tile(node: Node, local: LocalTile, reach: float) -> Entered:
    boxes = boxes_from(node, local.view.origin, local.view.margin)
    return enter_frustum(boxes, local.frustum, smaller(reach, local.rays[0].limit))


@wp.func
def most_of_tile(of_packets: vec8) -> float:
    return larger(
        larger(larger(of_packets[0], of_packets[1]), larger(of_packets[2], of_packets[3])),
        larger(larger(of_packets[4], of_packets[5]), larger(of_packets[6], of_packets[7])),
    )


@wp.func
def least_of_tile(of_packets: vec8) -> float:
    return smaller(
        smaller(smaller(of_packets[0], of_packets[1]), smaller(of_packets[2], of_packets[3])),
        smaller(smaller(of_packets[4], of_packets[5]), smaller(of_packets[6], of_packets[7])),
    )


cast_tile_through_shapes = traversal(
    "cast_tile_through_shapes", LocalTile, vec8, enter_of_tile, most_of_tile, visit_shape_of_tile
)


@wp.func
def cast_tile(g: Geometry, rays: wp.array[TileRays]) -> None:
    """Find the first hits of a tile's rays among the visible shapes, in its slots; they may lie beyond the limit."""
    tile = rays[0].tile
    rays[0].met = 0
    reach = vec8()
    p_low = tile.p_low
    p_high = tile.p_high
    q_low = tile.q_low
    q_high = tile.q_high
    packets = tile.packets
    for k in range(PACKETS):
        has_rays = packets & (1 << k) != 0
        reach[k] = wp.where(has_rays, wp.inf, -wp.inf)
        p_low[k] = wp.where(has_rays, p_low[k], wp.inf)
        p_high[k] = wp.where(has_rays, p_high[k], -wp.inf)
        q_low[k] = wp.where(has_rays, q_low[k], wp.inf)
        q_high[k] = wp.where(has_rays, q_high[k], -wp.inf)
    identity = wp.identity(n=3, dtype=wp.float64)
    local = LocalTile()
    local.rays = rays
    span = rays[0].scope.span
    view = view_from(rays[0].origin - g.anchor[span], identity, rays, g.top_reach[span])
    local.view = view
    local.frustum = frustum_of(
        view, least_of_tile(p_low), most_of_tile(p_high), least_of_tile(q_low), most_of_tile(q_high)
    )
    reach = cast_tile_through_shapes(g, g.top, span * g.top_count, local, reach)
    if g.hfields.shape[0] > 0:
        cast_tile_through_hfields(rays, reach)
