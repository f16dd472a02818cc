"""One ray through both levels of the geometry on the CPU: the tree over shapes, and the triangle tree of each shape.

Box and edge tests may use fused multiply-adds where the CPU has them. So the nodes and triangles that are looked at may
differ between CPUs; the hits do not.
"""

from collections.abc import Callable
from typing import Any

import warp as wp

from rigcast.kernels.elements import bool_at, double_vector_at, float_at, int_at, vector_at
from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.hits.hit import APART, Hit, WorldRay, decided, hit_within, is_beyond, is_sure, no_hit
from rigcast.kernels.inline import noinline
from rigcast.kernels.poses.scope import Scope, is_somewhere, pose_of
from rigcast.kernels.shapes.facets import normal_of_block, triangle_of_block, vector_of_block
from rigcast.kernels.shapes.patches import compose, is_in_plots, open_plot
from rigcast.kernels.shapes.solids import SHEET, has_triangles, triage_closed_form
from rigcast.kernels.shapes.triangle import CULL_FRONT, CULL_NONE, triage_inside, triage_triangle
from rigcast.kernels.trees.nodes import FIRST_PATCH, FIRST_PLOT, NO_CHILD, WIDTH, Node
from rigcast.kernels.vectors import larger, lowest_bit, smaller, to_double, to_float

from .leaves import passed_in_block
from .walk import leaf_of, next_leaf, top_of

MARGIN = wp.constant(4.0 * 2.0**-23)
SMALLEST = wp.constant(1.0e-20)


@wp.struct
class Ray:
    """A ray in the frame of a tree, and the same ray in the world."""

    # in the tree's frame:
    origin: wp.vec3
    origin_rest: wp.vec3  # what rounding the origin to float32 loses
    direction: wp.vec3
    inverse: wp.vec3  # 1 / direction, finite
    margin: float  # by which boxes are widened [m]: covers all rounding of the box test
    shape: int
    cull: int
    # in the world, as single fields: a WorldRay that is passed on would stay in memory and be copied for every shape
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
    """1 / x, with |x| kept off 0, so that 0 * inf cannot arise at the faces of boxes."""
    return 1.0 / wp.where(wp.abs(x) < SMALLEST, SMALLEST, x)


@wp.func
def box_margin(origin: wp.vec3, reach: float) -> float:
    """Margin [m] by which to widen boxes with coordinates up to reach in tests of rays from the origin.

    For a box of centre c and half size h it covers the roundings of o, d and 1 / d; of c - o and its product with
    1 / d, or of the products of c and of o with 1 / d and their difference; and of the sums with h. In all these are
    less than 8u (|o| + reach), u = 2^-24.
    """
    farthest = larger(larger(wp.abs(origin[0]), wp.abs(origin[1])), wp.abs(origin[2]))
    return MARGIN * (farthest + reach)


@wp.func
def in_frame_of_tree(ray: Ray, origin: wp.vec3d, direction: wp.vec3d, reach: float) -> Ray:
    """The ray in the frame of a tree. origin, direction: of the ray there. reach: the tree's largest coordinate [m]."""
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
def limit_of(ray: Ray, best: Hit) -> float:
    """Distance [m] beyond which no hit can be the first one."""
    return smaller(best.far * APART, ray.limit)


@wp.func
def nearer(g: wp.array[Geometry], ray: Ray, best: Hit, hit: Hit) -> Hit:
    """The first of two hits."""
    if is_beyond(hit, best):
        return best
    if is_sure(hit, best):
        return hit
    return decided(g, best, hit, in_world(ray))


@wp.func
def meet_inside(blocks: wp.array[TriangleBlock], at: int, ray: Ray, number: int) -> Hit:
    """Test the ray against triangle `at` of the blocks, which it surely passes inside. number: see meet_triangle."""
    v0 = (vector_of_block(blocks, at, 0) - ray.origin) - ray.origin_rest
    span = triage_inside(ray.direction, v0, normal_of_block(blocks, at), ray.cull)
    return hit_within(span[0], span[1], ray.shape, number)


@wp.func
def meet_triangle(blocks: wp.array[TriangleBlock], at: int, ray: Ray, number: int) -> Hit:
    """Test the ray against triangle `at` of the blocks. number: of the triangle in the tree, stored with the hit."""
    v = triangle_of_block(blocks, at)
    v0 = (v.a - ray.origin) - ray.origin_rest
    v1 = (v.b - ray.origin) - ray.origin_rest
    v2 = (v.c - ray.origin) - ray.origin_rest
    normal = normal_of_block(blocks, at)
    span = triage_triangle(ray.direction, v.a - v.b, v.b - v.c, v.c - v.a, v0, v1, v2, normal, ray.cull)
    return hit_within(span[0], span[1], ray.shape, number)


@wp.func
def visit_leaf(
    g: wp.array[Geometry],
    ray: Ray,
    index: int,
    stack: wp.array[int],  # noqa: ARG001
    top: int,  # noqa: ARG001
    composed: wp.array[TriangleBlock],
    best: Hit,
) -> Hit:
    """Test the ray against the triangles of one block or patch; return the first hit so far."""
    blocks = g[0].blocks
    k = int(index)
    if index >= FIRST_PATCH:
        compose(g[0].plots, g[0].sides, index - FIRST_PATCH, composed)
        blocks = composed
        k = 0
    passed = passed_in_block(blocks, k, ray.origin, ray.origin_rest, ray.direction, ray.margin)
    while passed & 255 != 0:
        j = lowest_bit(passed)
        hit = Hit()
        if (passed >> (WIDTH + j)) & 1 != 0:
            hit = meet_inside(blocks, k * WIDTH + j, ray, index * WIDTH + j)
        else:
            hit = meet_triangle(blocks, k * WIDTH + j, ray, index * WIDTH + j)
        passed = passed & (passed - 1)
        best = nearer(g, ray, best, hit)
    return best


def ray_traversal(name: str, visit: Callable[..., Any]) -> Any:
    """A Warp function that takes a ray through a tree, leaf by leaf, and returns the first hit so far.

    Args:
        visit: (g, ray, leaf, stack, height of the stack, composed, best) -> the first hit so far.
    """

    def traverse(
        g: wp.array[Geometry],
        nodes: wp.array[Node],
        ray: Ray,
        root: int,
        stack: wp.array[int],
        bottom: int,
        composed: wp.array[TriangleBlock],
        best: Hit,
    ) -> Hit:
        at = int(root)
        top = int(bottom)
        while True:
            limit = limit_of(ray, best)
            found = next_leaf(nodes, at, ray.origin, ray.inverse, ray.margin, limit, stack, top, bottom)
            leaf = leaf_of(found)
            if leaf == NO_CHILD:
                break
            top = top_of(found)
            best = visit(g, ray, -1 - leaf, stack, top, composed, best)
            at = NO_CHILD
        return best

    traverse.__name__ = traverse.__qualname__ = name
    return wp.func(traverse)


cast_through_triangles = ray_traversal("cast_through_triangles", visit_leaf)


@wp.func
def visit_shape(
    g: wp.array[Geometry],
    ray: Ray,
    shape: int,
    stack: wp.array[int],
    top: int,
    composed: wp.array[TriangleBlock],
    best: Hit,
) -> Hit:
    """Cast the ray against one shape, if it is visible; return the first hit so far. top: height of the stack."""
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
    entry = scope.first_shape + shape
    if is_in_plots(g[0].hfields, g[0].columns, entry):
        return best
    if has_triangles(kind):
        local = in_frame_of_tree(ray, origin, direction, float_at(g[0].reach, entry))
        local.shape = shape
        local.cull = wp.where(kind == SHEET, CULL_NONE, ray.cull)
        return cast_through_triangles(g, g[0].nodes, local, int_at(g[0].root, entry), stack, top, composed, best)
    span = triage_closed_form(kind, vector_at(g[0].size, entry), to_float(origin), to_float(direction), ray.cull)
    return nearer(g, ray, best, hit_within(span[0], span[1], shape, 0))


cast_through_shapes = ray_traversal("cast_through_shapes", visit_shape)


@wp.func
def visit_leaf_of_hfield(
    g: wp.array[Geometry],
    ray: Ray,
    index: int,
    stack: wp.array[int],
    top: int,
    composed: wp.array[TriangleBlock],
    best: Hit,
) -> Hit:
    """Test the ray against the patches of a plot, or against a block of triangles of the field's sides and bottom."""
    if index >= FIRST_PLOT:
        opened = wp.zeros(shape=1, dtype=Node)
        open_plot(g[0].plots, g[0].sides, index - FIRST_PLOT, opened)
        return cast_through_triangles(g, opened, ray, 0, stack, top, composed, best)
    return visit_leaf(g, ray, index, stack, top, composed, best)


cast_through_leaves_of_hfield = ray_traversal("cast_through_leaves_of_hfield", visit_leaf_of_hfield)


@wp.func
def cast_through_hfield(
    g: wp.array[Geometry], ray: Ray, shape: int, stack: wp.array[int], composed: wp.array[TriangleBlock], best: Hit
) -> Hit:
    """Cast the ray against one visible field that is kept in plots; return the first hit so far."""
    pose = pose_of(g, shape, ray.scope)
    if not is_somewhere(pose):
        return best
    to_local = wp.transpose(pose.rotation)
    entry = ray.scope.first_shape + shape
    origin = to_local * (ray.world_origin - pose.position)
    local = in_frame_of_tree(ray, origin, to_local * ray.world_direction, float_at(g[0].reach, entry))
    local.shape = shape
    return cast_through_leaves_of_hfield(g, g[0].nodes, local, int_at(g[0].root, entry), stack, 0, composed, best)


@noinline
def cast_through_hfields(
    g: wp.array[Geometry], ray: Ray, stack: wp.array[int], composed: wp.array[TriangleBlock], best: Hit
) -> Hit:
    """Cast the ray against all visible fields kept in plots, after all other shapes; see packets.traverse.plots."""
    scope = ray.scope
    for k in range(g[0].hfields.shape[0]):
        shape = int_at(g[0].hfields, k)
        is_seen = bool_at(g[0].visible, scope.first_visible + shape)
        if is_seen and is_in_plots(g[0].hfields, g[0].columns, scope.first_shape + shape):
            best = cast_through_hfield(g, ray, shape, stack, composed, best)
    return best


@wp.func
def cast_ray(g: wp.array[Geometry], world: WorldRay, stack: wp.array[int], composed: wp.array[TriangleBlock]) -> Hit:
    """The first hit of a ray among the visible shapes; it may lie beyond the limit.

    Args:
        stack: (NUMBERS_OF_STACK,) scratch.
        composed: (1,) scratch.
    """
    ray = Ray()
    ray.world_origin = world.origin
    ray.world_direction = world.direction
    ray.scope = world.scope
    ray.limit = world.limit
    ray.world_cull = world.cull
    ray.cull = world.cull
    span = world.scope.span
    origin = world.origin - double_vector_at(g[0].anchor, span)
    ray = in_frame_of_tree(ray, origin, world.direction, float_at(g[0].top_reach, span))
    best = cast_through_shapes(g, g[0].top, ray, span * g[0].top_count, stack, 0, composed, no_hit())
    if g[0].hfields.shape[0] > 0:
        best = cast_through_hfields(g, ray, stack, composed, best)
    return best
