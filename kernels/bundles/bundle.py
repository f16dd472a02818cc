"""Traversal of the tree over the shapes, and of a shape's triangle tree, by a bundle."""

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.hits.hit import APART, Hit, WorldRay, decided, hit_within, is_beyond, is_sure
from rigcast.kernels.inline import noinline
from rigcast.kernels.poses.scope import pose_of
from rigcast.kernels.shapes.patches import compose, open_plot
from rigcast.kernels.shapes.solids import SHEET, has_triangles, triage_closed_form
from rigcast.kernels.shapes.triangle import CULL_FRONT, CULL_NONE
from rigcast.kernels.single.ray import Ray, in_frame_of_tree, in_world
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, OUTWARDS, WIDTH, Node, vec8, vec8i
from rigcast.kernels.trees.traverse import Entered, sign_bits, traversal
from rigcast.kernels.vectors import larger, lowest_bit, smaller, to_float

from .sides import meet_sides, sides_of


@wp.struct
class Member:
    """A ray of a bundle: number, origin in the world, offset from the middle in a tree's frame, first hit so far."""

    number: int
    origin: wp.vec3d
    offset: wp.vec3
    best: Hit


@wp.struct
class Bundle:
    """The middle ray of a bundle in the frame of a tree, and its members."""

    middle: Ray
    spread: wp.vec3  # the largest |offset| of any member along each axis [m]
    members: wp.array[Member]  # members[first : first + count] belong to this bundle
    first: int
    count: int
    composed: wp.array[TriangleBlock]  # (1,) the triangles of a patch


@wp.func
def seen_from(bundle: Bundle, origin: wp.vec3d, direction: wp.vec3d, spread: wp.vec3d, reach: float) -> Bundle:
    """The bundle in the frame of a tree with coordinates up to reach [m]; origin, direction, spread: in that frame.

    The margin of boxes is that for coordinates up to reach + 2 spread, which covers the rounding of the spread.
    """
    local = bundle
    local.spread = to_float(spread) * OUTWARDS
    widest = larger(larger(local.spread[0], local.spread[1]), local.spread[2])
    local.middle = in_frame_of_tree(bundle.middle, origin, direction, reach + 2.0 * widest)
    return local


@wp.func
def reach_of_members(bundle: Bundle) -> float:
    """Distance [m] beyond which no ray of the bundle can have a first hit."""
    reach = float(0.0)
    for k in range(bundle.first, bundle.first + bundle.count):
        reach = larger(reach, bundle.members[k].best.far)
    return reach * APART


@wp.func
def world_ray_of(bundle: Bundle, k: int) -> WorldRay:
    ray = in_world(bundle.middle)
    ray.origin = bundle.members[k].origin
    return ray


@wp.func
def offer_to_member(g: wp.array[Geometry], bundle: Bundle, k: int, hit: Hit) -> None:
    best = bundle.members[k].best
    if is_sure(hit, best):
        bundle.members[k].best = hit
    elif not is_beyond(hit, best):
        bundle.members[k].best = decided(g, best, hit, world_ray_of(bundle, k))


@wp.func
def enter_boxes(node: Node, ray: Ray, wider: wp.vec3, reach: float) -> Entered:
    """The boxes of a node, widened by `wider` along each axis, that the ray enters within its limit and reach [m].

    The fields are copied out of their structs for the reason given in rigcast.kernels.bundles.sides.
    """
    center_x = node.center_x
    center_y = node.center_y
    center_z = node.center_z
    half_x = node.half_x
    half_y = node.half_y
    half_z = node.half_z
    origin = ray.origin
    inverse = ray.inverse
    speed = wp.abs(inverse)
    limit = smaller(reach, ray.limit)
    distance = vec8()
    entering = vec8i()
    for j in range(WIDTH):
        cx = (center_x[j] - origin[0]) * inverse[0]
        cy = (center_y[j] - origin[1]) * inverse[1]
        cz = (center_z[j] - origin[2]) * inverse[2]
        hx = (half_x[j] + wider[0]) * speed[0]
        hy = (half_y[j] + wider[1]) * speed[1]
        hz = (half_z[j] + wider[2]) * speed[2]
        enter = larger(larger(cx - hx, cy - hy), larger(cz - hz, 0.0))
        leave = smaller(smaller(cx + hx, cy + hy), smaller(cz + hz, limit))
        distance[j] = enter
        # the last condition excludes absent children for any ray and box, as larger and smaller drop NaN
        entering[j] = wp.where(enter <= leave and half_x[j] >= 0.0, -1, 0)
    entered = Entered()
    entered.children = sign_bits(entering)
    entered.distance = distance
    return entered


@wp.func
def enter_of_bundle(node: Node, bundle: Bundle, reach: float) -> Entered:
    """The boxes of a node that any ray of the bundle may enter."""
    margin = bundle.middle.margin
    return enter_boxes(node, bundle.middle, bundle.spread + wp.vec3(margin, margin, margin), reach)


@wp.func
def reach_of_bundle(reach: float) -> float:
    return reach


@wp.func
def visit_block_of_bundle(g: wp.array[Geometry], bundle: Bundle, index: int, distance: float, reach: float) -> float:
    """Test the rays that may still have a hit at `distance` against a block's triangles; return the new reach [m]."""
    blocks = g[0].blocks
    block = int(index)
    if index >= FIRST_PATCH:
        compose(g[0].plots, g[0].sides, index - FIRST_PATCH, bundle.composed)
        blocks = bundle.composed
        block = 0
    sides = sides_of(blocks[block], bundle.middle, bundle.spread)
    some = int(0)
    for k in range(bundle.first, bundle.first + bundle.count):
        if distance <= bundle.members[k].best.far * APART:
            spans = meet_sides(sides, blocks[block], bundle.members[k].offset, bundle.middle.cull)
            near = spans.near
            far = spans.far
            possible = spans.possible
            some = some | possible
            while possible != 0:
                j = lowest_bit(possible)
                possible = possible & (possible - 1)
                hit = hit_within(near[j], far[j], bundle.middle.shape, index * WIDTH + j)
                offer_to_member(g, bundle, k, hit)
    if some == 0:
        return reach
    return reach_of_members(bundle)


@noinline
def visit_plot_of_bundle(g: wp.array[Geometry], bundle: Bundle, k: int, reach: float) -> float:
    """Test the rays against all patches of plot k that any of them may enter; return the new reach [m]."""
    opened = wp.zeros(shape=1, dtype=Node)
    open_plot(g[0].plots, g[0].sides, k, opened)
    entered = enter_of_bundle(opened[0], bundle, reach)
    distance = entered.distance
    patches = entered.children
    while patches != 0:
        j = lowest_bit(patches)
        patches = patches & (patches - 1)
        reach = visit_block_of_bundle(g, bundle, FIRST_PATCH + WIDTH * k + j, distance[j], reach)
    return reach


@wp.func
def visit_leaf_of_bundle(g: wp.array[Geometry], bundle: Bundle, index: int, distance: float, reach: float) -> float:
    if index >= FIRST_PLOT:
        return visit_plot_of_bundle(g, bundle, index - FIRST_PLOT, reach)
    return visit_block_of_bundle(g, bundle, index, distance, reach)


cast_bundle_through_triangles = traversal(
    "cast_bundle_through_triangles", Bundle, float, enter_of_bundle, reach_of_bundle, visit_leaf_of_bundle
)


@wp.func
def among_triangles(bundle: Bundle, center: wp.vec3d, to_local: wp.mat33d, position: wp.vec3d, reach: float) -> Bundle:
    """The bundle in the frame of a shape; writes its members' offsets from `center`, a point in the world."""
    middle = to_local * (center - position)
    spread = wp.vec3d()
    for k in range(bundle.first, bundle.first + bundle.count):
        offset = to_local * (bundle.members[k].origin - position) - middle
        bundle.members[k].offset = to_float(offset)
        spread = wp.max(spread, wp.abs(offset))
    return seen_from(bundle, middle, to_local * bundle.middle.world_direction, spread, reach)


@wp.func
def visit_shape_of_bundle(g: wp.array[Geometry], bundle: Bundle, shape: int, distance: float, reach: float) -> float:  # noqa: ARG001
    """Cast the rays against one shape, if it is visible; return the new reach [m]."""
    scope = bundle.middle.scope
    kind = g[0].kind[shape]
    if not g[0].visible[scope.first_visible + shape] or (kind == SHEET and bundle.middle.cull == CULL_FRONT):
        return reach
    pose = pose_of(g, shape, scope)
    to_local = wp.transpose(pose.rotation)
    at = scope.first_shape + shape
    if has_triangles(kind):
        local = among_triangles(bundle, bundle.middle.world_origin, to_local, pose.position, g[0].reach[at])
        local.middle.shape = shape
        local.middle.cull = wp.where(kind == SHEET, CULL_NONE, bundle.middle.cull)
        return cast_bundle_through_triangles(g, g[0].nodes, g[0].root[at], local, reach)
    size = g[0].size[at]
    direction = to_float(to_local * bundle.middle.world_direction)
    for k in range(bundle.first, bundle.first + bundle.count):
        origin = to_float(to_local * (bundle.members[k].origin - pose.position))
        span = triage_closed_form(kind, size, origin, direction, bundle.middle.cull)
        offer_to_member(g, bundle, k, hit_within(span[0], span[1], shape, 0))
    return reach_of_members(bundle)


cast_bundle_through_shapes = traversal(
    "cast_bundle_through_shapes", Bundle, float, enter_of_bundle, reach_of_bundle, visit_shape_of_bundle
)


@wp.func
def cast_bundle(g: wp.array[Geometry], bundle: Bundle) -> None:
    """Find the first hits of a bundle's rays among the visible shapes, in its members; some may be beyond the limit."""
    low = bundle.members[bundle.first].origin
    high = low
    for k in range(bundle.first + 1, bundle.first + bundle.count):
        low = wp.min(low, bundle.members[k].origin)
        high = wp.max(high, bundle.members[k].origin)
    whole = bundle
    whole.middle.world_origin = wp.float64(0.5) * low + wp.float64(0.5) * high
    spread = wp.max(high - whole.middle.world_origin, whole.middle.world_origin - low)
    span = bundle.middle.scope.span
    origin = whole.middle.world_origin - g[0].anchor[span]
    whole = seen_from(whole, origin, bundle.middle.world_direction, spread, g[0].top_reach[span])
    cast_bundle_through_shapes(g, g[0].top, span * g[0].top_count, whole, wp.inf)
