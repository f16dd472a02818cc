"""A packet in the frame of a shape, with everything the shape's boxes and triangles are tested against."""

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.inline import inlined
from rigcast.kernels.packets.packet import PacketRays, TileRays, Vectors, View, packet_of
from rigcast.kernels.trees.nodes import Node

from .edges import side_rounding
from .frustum import LANE_ROUNDING
from .slabs import Way, margin_of_lanes, way_of


@wp.struct
class LocalPacket:
    """A packet in the frame of one shape with triangles."""

    packet: PacketRays
    nodes: wp.array[Node]
    blocks: wp.array[TriangleBlock]
    shape: int
    cull: int
    view: View
    way: Way
    directions: wp.array[Vectors]  # (1,) unit
    # a + p u + q v of every ray lies within middle +- spread:
    middle: wp.vec3
    spread: wp.vec3
    widest: float  # the largest 1 + |p| + |q|
    side_rounding: float  # see rigcast.kernels.packets.intersect.edges
    margin: float  # by which boxes are widened [m]


@inlined
def packet_among_triangles(
    g: Geometry, rays: wp.array[TileRays], view: View, k: int, shape: int, cull: int
) -> LocalPacket:
    """Packet k of a tile in the frame of one shape."""
    tile = rays[0].tile
    local = LocalPacket()
    local.packet = packet_of(rays, k)
    local.nodes = g.nodes
    local.blocks = g.blocks
    local.shape = shape
    local.cull = cull
    local.view = view
    local.directions = rays[0].local
    p = 0.5 * (tile.p_low[k] + tile.p_high[k])
    q = 0.5 * (tile.q_low[k] + tile.q_high[k])
    p_half = 0.5 * (tile.p_high[k] - tile.p_low[k])
    q_half = 0.5 * (tile.q_high[k] - tile.q_low[k])
    local.widest = 1.0 + wp.abs(p) + p_half + wp.abs(q) + q_half
    local.middle = view.axis + p * view.u + q * view.v
    local.spread = p_half * wp.abs(view.u) + q_half * wp.abs(view.v)
    local.side_rounding = side_rounding(local.widest)
    local.margin = margin_of_lanes(view, local.widest)
    rounding = LANE_ROUNDING * local.widest
    spread = local.spread + wp.vec3(rounding, rounding, rounding)
    local.way = way_of(rays[0].packets[local.packet.packet], view, local.middle, spread, local.directions)
    return local
