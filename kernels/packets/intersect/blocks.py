"""Packets against the triangles of a leaf.

If more than FEW rays enter the leaf, its triangles are tested one after the other, each against all lanes at once.
Otherwise those rays are tested one after the other, each against all eight triangles of the block at once.
"""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock
from rigcast.kernels.hits.hit import APART
from rigcast.kernels.inline import inlined
from rigcast.kernels.packets.lanes import far_of, near_of, vector_of_lane
from rigcast.kernels.packets.packet import TileRays, decide_lane_of_packet, max_of_lanes, offer
from rigcast.kernels.shapes.patches import compose
from rigcast.kernels.trees.nodes import FIRST_PATCH, WIDTH
from rigcast.kernels.vectors import count_bits, lowest_bit

from .edges import edges_of, may_be_hit, meet_plane, meet_triangles, pass_edges
from .local_packet import LocalPacket

FEW = wp.constant(6)
"""Number of active rays up to which testing them one by one is faster."""


@inlined
def visit_block_lane_by_lane(
    local: LocalPacket, index: int, lanes: int, reach: float, blocks: wp.array[TriangleBlock], block: int
) -> float:
    """Test these lanes (a bit mask), one by one, against a block of triangles; return the packet's new reach [m]."""
    best = local.packet.best
    slot = local.packet.slot
    edges = edges_of(blocks[block], local.view, local.side_rounding)
    some = int(0)
    while lanes != 0:
        i = lowest_bit(lanes)
        lanes = lanes & (lanes - 1)
        limit = far_of(best, slot, i) * APART
        met = meet_triangles(edges, vector_of_lane(local.directions, i), local.cull, limit)
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
                best[slot].shape[i] = local.shape
                best[slot].triangle[i] = index * WIDTH + j
            elif near[j] <= far_of(best, slot, i) * APART:
                decide_lane_of_packet(local.packet.tile, slot, i, near[j], far[j], local.shape, index * WIDTH + j)
    if some == 0:
        return reach
    return APART * max_of_lanes(local.packet.best[slot].far)


@inlined
def visit_block_at_once(
    local: LocalPacket, index: int, reach: float, blocks: wp.array[TriangleBlock], block: int
) -> float:
    """Test all lanes of a packet against the triangles of one block, one by one; return the packet's new reach [m]."""
    edges = edges_of(blocks[block], local.view, local.side_rounding)
    side0_of = edges.side0
    side1_of = edges.side1
    side2_of = edges.side2
    normal_of = edges.normal
    rounding = edges.rounding
    height = edges.height
    size = edges.size
    possible = may_be_hit(edges, local.middle, local.spread, local.widest)
    while possible != 0:
        j = lowest_bit(possible)
        possible = possible & (possible - 1)
        side0 = wp.vec3(side0_of[0, j], side0_of[1, j], side0_of[2, j])
        side1 = wp.vec3(side1_of[0, j], side1_of[1, j], side1_of[2, j])
        side2 = wp.vec3(side2_of[0, j], side2_of[1, j], side2_of[2, j])
        inside = pass_edges(
            local.directions[0].x, local.directions[0].y, local.directions[0].z, side0, side1, side2, rounding[j]
        )
        if inside.some != 0:
            met = meet_plane(
                local.directions[0].x,
                local.directions[0].y,
                local.directions[0].z,
                inside.by,
                wp.vec3(normal_of[0, j], normal_of[1, j], normal_of[2, j]),
                rounding[j],
                height[j],
                size[j],
                local.cull,
            )
            reach = offer(local.packet, met.near, met.far, local.shape, index * WIDTH + j, reach)
    return reach


@wp.func
def compose_patch(rays: wp.array[TileRays], k: int) -> None:
    """Make the triangles of patch k, unless the tile already has them: neighbouring packets often need the same."""
    if rays[0].patch != k:
        g = rays[0].geometry
        compose(g[0].plots, g[0].sides, k, rays[0].composed)
        rays[0].patch = k


@inlined
def visit_block_of_packet(local: LocalPacket, index: int, lanes: int, reach: float) -> float:
    """Test a packet against the triangles of one block or patch; return its new reach [m]. lanes: those in the box."""
    blocks = local.blocks
    block = int(index)
    if index >= FIRST_PATCH:
        compose_patch(local.packet.tile, index - FIRST_PATCH)
        blocks = local.packet.tile[0].composed
        block = 0
    if count_bits(lanes) <= FEW:
        return visit_block_lane_by_lane(local, index, lanes, reach, blocks, block)
    return visit_block_at_once(local, index, reach, blocks, block)
