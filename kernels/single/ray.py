"""One ray through both levels of the geometry: the tree over shapes, and the tree over each shape's triangles."""

import warp as wp

from rigcast.kernels.elements import bool_at, double_vector_at, float_at, int_at, vector_at
from rigcast.kernels.geometry import Geometry, Patch, TriangleBlock
from rigcast.kernels.hits.hit import APART, Hit, WorldRay, decided, hit_within, is_beyond, is_sure, no_hit
from rigcast.kernels.inline import noinline
from rigcast.kernels.poses.scope import Scope, pose_of
from rigcast.kernels.shapes.facets import normal_of_block, triangle_of_block
from rigcast.kernels.shapes.patches import compose
from rigcast.kernels.shapes.solids import SHEET, has_triangles, triage_closed_form
from rigcast.kernels.shapes.triangle import CULL_FRONT, CULL_NONE, may_be_inside, triage_triangle
from rigcast.kernels.trees.nodes import FIRST_PATCH, NO_CHILD, WIDTH, Node, vec8, vec8i
from rigcast.kernels.vectors import larger, lowest_bit, smaller, to_double, to_float

from .traverse import Entered, sign_bits
from .leaves import passed_in_block
from .walk import leaf_of, next_leaf, top_of

MARGIN = wp.constant(4.0 * 2.0**-23)
SMALLEST = wp.constant(1.0e-20)


@wp.struct
class Ray:
    """A ray in the frame of a tree, and that of the world which it came from."""

    # in the tree's frame:
    origin: wp.vec3
    origin_rest: wp.vec3  # what is lost in rounding the origin to float32
    direction: wp.vec3
    inverse: wp.vec3  # 1 / direction, finite
    margin: float  # by which boxes are widened: covers all rounding in enter_boxes
    shape: int
    cull: int
    # in the world, field by field: a struct that is passed on as it is stays in memory, and is copied for every shape
    world_origin: wp.vec3d
    world_direction: wp.vec3d
    scope: Scope
    limit: float
    world_cull: int


@wp.func
def in_world(ray: Ray) -> WorldRay:
    world = WorldRay()
    world.origin = ray.world_origin
    world.direction = ray.world_direction
    world.scope = ray.scope
    world.limit = ray.limit
    world.cull = ray.world_cull
    return world


@wp.func
def inverse_of(x: float) -> float:
    """1 / x, with x kept off 0, so that 0 * inf cannot arise at the faces of boxes."""
    return 1.0 / wp.where(wp.abs(x) < SMALLEST, SMALLEST, x)


@wp.func
def box_margin(origin: wp.vec3, reach: float) -> float:
    """By how much to widen boxes with coordinates up to reach, seen from the origin.

    It covers, for a box of centre c and half size h, the roundings of o, c - o, its product with 1 / d, and the sums
    with h: fewer than 8u (|o| + reach) in all, u = 2^-24.
    """
    farthest = larger(larger(wp.abs(origin[0]), wp.abs(origin[1])), wp.abs(origin[2]))
    return MARGIN * (farthest + reach)


@wp.func
def in_frame_of_tree(ray: Ray, origin: wp.vec3d, direction: wp.vec3d, reach: float) -> Ray:
    """The ray as a tree with coordinates up to reach sees it."""
    local = ray
    local.origin = to_float(origin)
    local.origin_rest = to_float(origin - to_double(local.origin))
    local.direction = to_float(direction)
    local.inverse = wp.vec3(
        inverse_of(local.direction[0]), inverse_of(local.direction[1]), inverse_of(local.direction[2])
    )
    local.margin = box_margin(local.origin, reach)
    return local


@wp.func
def enter_boxes(node: Node, ray: Ray, wider: wp.vec3, reach: float) -> Entered:
    """The boxes, wider by so much along each axis, that the ray enters no farther than its limit and reach."""
    # fields are taken out of their structs first: a loop that reads through a struct is not vectorised
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
        # the last condition keeps absent children out whatever rays and boxes are: NaN is lost in larger and smaller
        entering[j] = wp.where(enter <= leave and half_x[j] >= 0.0, -1, 0)
    entered = Entered()
    entered.children = sign_bits(entering)
    entered.distance = distance
    return entered


@wp.struct
class Spans:
    """From where to where a ray's distances to the triangles of a block may be, and which, bit by bit, may be hit."""

    near: vec8
    far: vec8
    possible: int


@wp.func
def reach_of_ray(best: Hit) -> float:
    return best.far * APART


@wp.func
def meet_triangle(
    g: wp.array[Geometry], blocks: wp.array[TriangleBlock], k: int, j: int, ray: Ray, triangle: int, best: Hit
) -> Hit:
    v = triangle_of_block(blocks, k * WIDTH + j)
    normal = normal_of_block(blocks, k * WIDTH + j)
    origin = ray.origin
    rest = ray.origin_rest
    v0 = (v.a - origin) - rest
    v1 = (v.b - origin) - rest
    v2 = (v.c - origin) - rest
    span = triage_triangle(ray.direction, v.a - v.b, v.b - v.c, v.c - v.a, v0, v1, v2, normal, ray.cull)
    hit = hit_within(span[0], span[1], ray.shape, triangle)
    if is_sure(hit, best):
        return hit
    if is_beyond(hit, best):
        return best
    return decided(g, best, hit, in_world(ray))


@wp.func
def visit_block(g: wp.array[Geometry], ray: Ray, index: int, composed: wp.array[TriangleBlock], best: Hit) -> Hit:
    """The ray against the triangles of one block."""
    blocks = g[0].blocks
    k = int(index)
    if index >= FIRST_PATCH:
        compose(g[0].patches, index - FIRST_PATCH, composed)
        blocks = composed
        k = 0
    passed = passed_in_block(blocks, k, ray.origin, ray.origin_rest, ray.direction, ray.margin)
    while passed != 0:
        j = lowest_bit(passed)
        passed = passed & (passed - 1)
        best = meet_triangle(g, blocks, k, j, ray, index * WIDTH + j, best)
    return best


@wp.func
def limit_of(ray: Ray, best: Hit) -> float:
    return smaller(reach_of_ray(best), ray.limit)


@wp.func
def cast_through_triangles(
    g: wp.array[Geometry], ray: Ray, root: int, stack: wp.array[int], bottom: int, composed: wp.array[TriangleBlock], best: Hit
) -> Hit:
    at = int(root)
    top = int(bottom)
    while True:
        found = next_leaf(
            g[0].nodes, at, ray.origin, ray.inverse, ray.margin, limit_of(ray, best), stack, top, bottom
        )
        top = top_of(found)
        at = leaf_of(found)
        if at == NO_CHILD:
            break
        best = visit_block(g, ray, -1 - at, composed, best)
        at = NO_CHILD
    return best


@wp.func
def visit_shape(g: wp.array[Geometry], ray: Ray, shape: int, stack: wp.array[int], top: int, composed: wp.array[TriangleBlock], best: Hit) -> Hit:
    """The ray against one shape, if it is visible."""
    scope = ray.scope
    if not bool_at(g[0].visible, scope.first_visible + shape):
        return best
    pose = pose_of(g, shape, scope)
    to_local = wp.transpose(pose.rotation)
    origin = to_local * (ray.world_origin - pose.position)
    direction = to_local * ray.world_direction
    kind = int_at(g[0].kind, shape)
    if kind == SHEET and ray.cull == CULL_FRONT:
        return best
    if has_triangles(kind):
        local = in_frame_of_tree(ray, origin, direction, float_at(g[0].reach, scope.first_shape + shape))
        local.shape = shape
        local.cull = wp.where(kind == SHEET, CULL_NONE, ray.cull)
        return cast_through_triangles(g, local, int_at(g[0].root, scope.first_shape + shape), stack, top, composed, best)
    size = vector_at(g[0].size, scope.first_shape + shape)
    span = triage_closed_form(kind, size, to_float(origin), to_float(direction), ray.cull)
    hit = hit_within(span[0], span[1], shape, 0)
    if is_beyond(hit, best):
        return best
    if is_sure(hit, best):
        return hit
    return decided(g, best, hit, in_world(ray))


@wp.func
def cast_ray(g: wp.array[Geometry], world: WorldRay, stack: wp.array[int], composed: wp.array[TriangleBlock]) -> Hit:
    """The first hit of a ray among the visible shapes; it may lie beyond the limit."""
    ray = Ray()
    ray.world_origin = world.origin
    ray.world_direction = world.direction
    ray.scope = world.scope
    ray.limit = world.limit
    ray.world_cull = world.cull
    ray.cull = world.cull
    span = world.scope.span
    ray = in_frame_of_tree(ray, world.origin - double_vector_at(g[0].anchor, span), world.direction, float_at(g[0].top_reach, span))
    best = no_hit()
    at = int(span * g[0].top_count)
    top = int(0)
    while True:
        found = next_leaf(g[0].top, at, ray.origin, ray.inverse, ray.margin, limit_of(ray, best), stack, top, 0)
        top = top_of(found)
        at = leaf_of(found)
        if at == NO_CHILD:
            break
        best = visit_shape(g, ray, -1 - at, stack, top, composed, best)
        at = NO_CHILD
    return best
