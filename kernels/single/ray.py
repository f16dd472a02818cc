"""One ray through both levels of the geometry: the tree over shapes, and the tree over each shape's triangles."""

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.hits.hit import APART, Hit, WorldRay, decided, hit_within, is_beyond, is_sure, no_hit
from rigcast.kernels.inline import noinline
from rigcast.kernels.poses.scope import Scope, pose_of
from rigcast.kernels.shapes.patches import compose, open_plot
from rigcast.kernels.shapes.solids import SHEET, has_triangles, triage_closed_form
from rigcast.kernels.shapes.triangle import CULL_FRONT, CULL_NONE, may_be_inside, triage_triangle
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, WIDTH, Node, vec8, vec8i
from rigcast.kernels.vectors import larger, lowest_bit, smaller, to_double, to_float

from .traverse import Entered, child_among_triangles, sign_bits, traversal

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


@noinline
def triage_block(blocks: wp.array[TriangleBlock], k: int, ray: Ray) -> Spans:
    x0 = blocks[k].x0
    y0 = blocks[k].y0
    z0 = blocks[k].z0
    x1 = blocks[k].x1
    y1 = blocks[k].y1
    z1 = blocks[k].z1
    x2 = blocks[k].x2
    y2 = blocks[k].y2
    z2 = blocks[k].z2
    normal_x = blocks[k].normal_x
    normal_y = blocks[k].normal_y
    normal_z = blocks[k].normal_z
    origin = ray.origin
    rest = ray.origin_rest
    direction = ray.direction
    cull = ray.cull
    # most blocks have no triangle whose edges the ray passes, and need no more than this
    inside = vec8i()
    for j in range(WIDTH):
        a = wp.vec3(x0[j], y0[j], z0[j])
        b = wp.vec3(x1[j], y1[j], z1[j])
        c = wp.vec3(x2[j], y2[j], z2[j])
        v0 = (a - origin) - rest
        v1 = (b - origin) - rest
        v2 = (c - origin) - rest
        inside[j] = wp.where(may_be_inside(direction, a - b, b - c, c - a, v0, v1, v2), -1, 0)
    if sign_bits(inside) == 0:
        return Spans()
    near = vec8()
    far = vec8()
    possible = vec8i()
    for j in range(WIDTH):
        a = wp.vec3(x0[j], y0[j], z0[j])
        b = wp.vec3(x1[j], y1[j], z1[j])
        c = wp.vec3(x2[j], y2[j], z2[j])
        # vertices as seen from the ray's origin, to within 2u of the difference
        v0 = (a - origin) - rest
        v1 = (b - origin) - rest
        v2 = (c - origin) - rest
        normal = wp.vec3(normal_x[j], normal_y[j], normal_z[j])
        span = triage_triangle(direction, a - b, b - c, c - a, v0, v1, v2, normal, cull)
        near[j] = span[0]
        far[j] = span[1]
        possible[j] = wp.where(span[0] < wp.inf, -1, 0)
    spans = Spans()
    spans.near = near
    spans.far = far
    spans.possible = sign_bits(possible)
    return spans


@noinline
def triage_patch(g: wp.array[Geometry], k: int, ray: Ray) -> Spans:
    composed = wp.zeros(shape=1, dtype=TriangleBlock)
    compose(g[0].plots, g[0].sides, k, composed)
    return triage_block(composed, 0, ray)


@wp.func
def triage_leaf(g: wp.array[Geometry], index: int, ray: Ray) -> Spans:
    if index >= FIRST_PATCH:
        return triage_patch(g, index - FIRST_PATCH, ray)
    return triage_block(g[0].blocks, index, ray)


@wp.func
def reach_of_ray(best: Hit) -> float:
    return best.far * APART


@wp.func
def visit_block(g: wp.array[Geometry], ray: Ray, index: int, distance: float, best: Hit) -> Hit:  # noqa: ARG001
    """The ray against the triangles of one block."""
    spans = triage_leaf(g, index, ray)
    near = spans.near
    far = spans.far
    possible = spans.possible
    while possible != 0:
        j = lowest_bit(possible)
        possible = possible & (possible - 1)
        hit = hit_within(near[j], far[j], ray.shape, index * WIDTH + j)
        if is_sure(hit, best):
            best = hit
        elif not is_beyond(hit, best):
            best = decided(g, best, hit, in_world(ray))
    return best


@noinline
def enter_plot(g: wp.array[Geometry], k: int, ray: Ray, wider: wp.vec3, reach: float) -> Entered:
    """As enter_boxes, of the patches of plot k."""
    opened = wp.zeros(shape=1, dtype=Node)
    open_plot(g[0].plots, g[0].sides, k, opened)
    return enter_boxes(opened[0], ray, wider, reach)


@wp.func
def enter_among_triangles(g: wp.array[Geometry], nodes: wp.array[Node], at: int, ray: Ray, reach: float) -> Entered:
    wider = wp.vec3(ray.margin, ray.margin, ray.margin)
    if at >= FIRST_PLOT:
        return enter_plot(g, at - FIRST_PLOT, ray, wider, reach)
    return enter_boxes(nodes[at], ray, wider, reach)


cast_through_triangles = traversal(
    "cast_through_triangles", Ray, Hit, enter_among_triangles, reach_of_ray, visit_block, child_among_triangles
)


@wp.func
def visit_shape(g: wp.array[Geometry], ray: Ray, shape: int, distance: float, best: Hit) -> Hit:  # noqa: ARG001
    """The ray against one shape, if it is visible."""
    scope = ray.scope
    if not g[0].visible[scope.first_visible + shape]:
        return best
    pose = pose_of(g, shape, scope)
    to_local = wp.transpose(pose.rotation)
    origin = to_local * (ray.world_origin - pose.position)
    direction = to_local * ray.world_direction
    kind = g[0].kind[shape]
    if kind == SHEET and ray.cull == CULL_FRONT:
        return best
    if has_triangles(kind):
        local = in_frame_of_tree(ray, origin, direction, g[0].reach[scope.first_shape + shape])
        local.shape = shape
        local.cull = wp.where(kind == SHEET, CULL_NONE, ray.cull)
        return cast_through_triangles(g, g[0].nodes, g[0].root[scope.first_shape + shape], local, best)
    size = g[0].size[scope.first_shape + shape]
    span = triage_closed_form(kind, size, to_float(origin), to_float(direction), ray.cull)
    hit = hit_within(span[0], span[1], shape, 0)
    if is_beyond(hit, best):
        return best
    if is_sure(hit, best):
        return hit
    return decided(g, best, hit, in_world(ray))


@wp.func
def enter_among_shapes(g: wp.array[Geometry], nodes: wp.array[Node], at: int, ray: Ray, reach: float) -> Entered:  # noqa: ARG001
    return enter_boxes(nodes[at], ray, wp.vec3(ray.margin, ray.margin, ray.margin), reach)


cast_through_shapes = traversal("cast_through_shapes", Ray, Hit, enter_among_shapes, reach_of_ray, visit_shape)


@wp.func
def cast_ray(g: wp.array[Geometry], world: WorldRay) -> Hit:
    """The first hit of a ray among the visible shapes; it may lie beyond the limit."""
    ray = Ray()
    ray.world_origin = world.origin
    ray.world_direction = world.direction
    ray.scope = world.scope
    ray.limit = world.limit
    ray.world_cull = world.cull
    ray.cull = world.cull
    span = world.scope.span
    ray = in_frame_of_tree(ray, world.origin - g[0].anchor[span], world.direction, g[0].top_reach[span])
    return cast_through_shapes(g, g[0].top, span * g[0].top_count, ray, no_hit())
