"""A packet as the triangles of one shape see it."""

import warp as wp

from rigcast.kernels.geometry import Geometry, Patch, TriangleBlock
from rigcast.kernels.trees.nodes import Node

from .frustum import Frustum, frustum_of, inverse_directions, margin_of_lanes
from .packet import PacketRays, TileRays, Vectors, View, packet_of


@wp.struct
class Sought:
    """A packet as the triangles of one shape see it."""

    packet: PacketRays
    nodes: wp.array[Node]
    blocks: wp.array[TriangleBlock]
    patches: wp.array[Patch]
    composed: wp.array[TriangleBlock]  # one, of a patch
    shape: int
    cull: int
    view: View
    inverse: Vectors  # of the rays' unit directions
    frustum: Frustum
    # the middle of its range of p and q, and half its size:
    p: float
    q: float
    p_half: float
    q_half: float
    widest: float  # the largest 1 + |p| + |q|
    margin: float  # by which boxes are widened


@wp.func
def packet_among_triangles(g: Geometry, rays: wp.array[TileRays], view: View, k: int, shape: int, cull: int) -> Sought:
    """Packet k of a tile as one shape sees it."""
    tile = rays[0].tile
    sought = Sought()
    sought.packet = packet_of(rays, k)
    sought.nodes = g.nodes
    sought.blocks = g.blocks
    sought.patches = g.patches
    sought.composed = rays[0].composed
    sought.shape = shape
    sought.cull = cull
    sought.view = view
    sought.inverse = inverse_directions(rays[0].packets[rays[0].first_packet + k], view)
    sought.frustum = frustum_of(view, tile.p_low[k], tile.p_high[k], tile.q_low[k], tile.q_high[k])
    sought.p = 0.5 * (tile.p_low[k] + tile.p_high[k])
    sought.q = 0.5 * (tile.q_low[k] + tile.q_high[k])
    sought.p_half = 0.5 * (tile.p_high[k] - tile.p_low[k])
    sought.q_half = 0.5 * (tile.q_high[k] - tile.q_low[k])
    sought.widest = 1.0 + wp.abs(sought.p) + sought.p_half + wp.abs(sought.q) + sought.q_half
    sought.margin = margin_of_lanes(view, sought.widest)
    return sought
