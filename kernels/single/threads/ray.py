"""One ray through both levels of the geometry on CUDA.

Functions take the geometry twice: `g` by value, of which NVIDIA's compiler makes no copy and whose arrays it reads
directly, and `held` in an array of one, for functions shared with casts on the CPU. `visible` in both is that of the
ray's sensor.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry, Patch
from rigcast.kernels.hits.hit import APART, Hit, WorldRay, decided, hit_within, is_beyond, is_sure, no_hit
from rigcast.kernels.inline import noinline
from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.poses.scope import entry_of, pose_at
from rigcast.kernels.shapes.facets import (
    FIRST_IN_PATCHES,
    Triangle,
    normal_of_block,
    triangle_of_block,
    triangle_of_patches,
    vector_of_block,
)
from rigcast.kernels.shapes.solids import SHEET, has_triangles
from rigcast.kernels.shapes.triangle import CULL_FRONT, CULL_NONE, triage_inside, triage_triangle
from rigcast.kernels.single.ray import SMALLEST, box_margin
from rigcast.kernels.trees.nodes import NO_CHILD, WIDTH
from rigcast.kernels.vectors import lowest_bit, quotient, smaller, to_double, to_float

from .leaves import passed_in_leaf
from .solids import triage_closed_form
from .walk import address_of_nodes, address_of_visible, next_leaf

OVER_SHAPES, IN_SHAPE = wp.constant(0), wp.constant(1)
"""The two levels; the ray has a frame for each."""
CREDIT = wp.constant(64)
"""What the walk of a warp as one begins with; see next_leaf."""


@wp.struct
class Frame:
    """The ray in the frame of a tree."""

    origin: wp.vec3
    origin_rest: wp.vec3  # what rounding the origin to float32 loses
    direction: wp.vec3
    inverse: wp.vec3  # 1 / direction, finite
    margin: float  # see box_margin


@wp.struct
class Ray:
    """A ray in the world, its first hit so far, and the shape whose triangle tree it traverses."""

    number: int  # counted over all worlds
    world: WorldRay
    best: Hit
    shape: int
    cull: int  # of the shape's triangles


@wp.func_native(on_cuda("return __fdividef(1.0f, ::fabsf(x) < smallest ? smallest : x);"))
def inverse_of(x: float, smallest: float) -> float:  # type: ignore[empty-body]
    """1 / x with an error of at most 2 ulp, and |x| kept off 0 as in rigcast.kernels.single.ray."""


@wp.func
def frame_of(origin: wp.vec3d, direction: wp.vec3d, reach: float) -> Frame:
    """The ray in the frame of a tree with coordinates up to reach [m]."""
    frame = Frame()
    frame.origin = to_float(origin)
    frame.origin_rest = to_float(origin - to_double(frame.origin))
    frame.direction = to_float(direction)
    frame.inverse = wp.vec3(
        inverse_of(frame.direction[0], SMALLEST),
        inverse_of(frame.direction[1], SMALLEST),
        inverse_of(frame.direction[2], SMALLEST),
    )
    frame.margin = box_margin(frame.origin, reach)
    return frame


@noinline
def decide(held: wp.array[Geometry], ray: wp.array[Ray], hit: Hit) -> None:
    ray[0].best = decided(held, ray[0].best, hit, ray[0].world)


@wp.func
def offer(held: wp.array[Geometry], ray: wp.array[Ray], hit: Hit) -> None:
    """Keep the hit if it is before the best one."""
    if is_sure(hit, ray[0].best):
        ray[0].best = hit
    elif not is_beyond(hit, ray[0].best):
        decide(held, ray, hit)


@wp.func_native(
    on_cuda("const auto& own = patches.data[k]; return {own.x[column], own.y[row], own.z.data[row][column]};")
)
def corner_in(patches: wp.array[Patch], k: int, row: int, column: int) -> wp.vec3:
    """A corner of a patch."""


triangle_in = triangle_of_patches("triangle_in", wp.array[Patch], corner_in)
"""`triangle_of_patch` that takes the patches themselves, not the geometry."""


@wp.func_native(on_cuda("return ::rsqrtf(x);"))
def inverse_root(x: float) -> float:  # type: ignore[empty-body]
    """1 / sqrt(x) with an error of at most 2 ulp."""


@wp.func
def normal_in_patch(number: int, v: Triangle) -> wp.vec3:
    """Unit normal of triangle v of a patch, by the formula in rigcast.kernels.shapes.patches.

    From corner a the triangle rises along one axis, then along the other.
    """
    is_lower = number % WIDTH < WIDTH / 2
    beside = wp.where(is_lower, v.b, v.c)
    far = wp.where(is_lower, v.c, v.b)
    early = quotient(beside[2] - v.a[2], wp.where(is_lower, beside[0] - v.a[0], beside[1] - v.a[1]))
    late = quotient(far[2] - beside[2], wp.where(is_lower, far[1] - beside[1], far[0] - beside[0]))
    scale = inverse_root(1.0 + early * early + late * late)
    return scale * wp.vec3(-wp.where(is_lower, early, late), -wp.where(is_lower, late, early), 1.0)


@wp.func
def meet_inside(
    g: Geometry, held: wp.array[Geometry], ray: wp.array[Ray], frames: wp.array[Frame], number: int
) -> None:
    """Test the ray against a triangle that it surely passes inside."""
    corner = wp.vec3()
    normal = wp.vec3()
    if number >= FIRST_IN_PATCHES:
        v = triangle_in(g.patches, number - FIRST_IN_PATCHES)
        corner = v.a
        normal = normal_in_patch(number, v)
    else:
        corner = vector_of_block(g.blocks, number, 0)
        normal = normal_of_block(g.blocks, number)
    v0 = (corner - frames[IN_SHAPE].origin) - frames[IN_SHAPE].origin_rest
    span = triage_inside(frames[IN_SHAPE].direction, v0, normal, ray[0].cull)
    offer(held, ray, hit_within(span[0], span[1], ray[0].shape, number))


@noinline
def meet_at_edge(held: wp.array[Geometry], ray: wp.array[Ray], frames: wp.array[Frame], number: int) -> None:
    """Test the ray against a triangle that it may pass inside. Not inlined: it is rare, and would fill the cache."""
    v = Triangle()
    normal = wp.vec3()
    if number >= FIRST_IN_PATCHES:
        v = triangle_in(held[0].patches, number - FIRST_IN_PATCHES)
        normal = normal_in_patch(number, v)
    else:
        v = triangle_of_block(held[0].blocks, number)
        normal = normal_of_block(held[0].blocks, number)
    origin = frames[IN_SHAPE].origin
    rest = frames[IN_SHAPE].origin_rest
    direction = frames[IN_SHAPE].direction
    v0 = (v.a - origin) - rest
    v1 = (v.b - origin) - rest
    v2 = (v.c - origin) - rest
    span = triage_triangle(direction, v.a - v.b, v.b - v.c, v.c - v.a, v0, v1, v2, normal, ray[0].cull)
    offer(held, ray, hit_within(span[0], span[1], ray[0].shape, number))


@wp.func
def meet_leaf(g: Geometry, held: wp.array[Geometry], ray: wp.array[Ray], frames: wp.array[Frame], leaf: int) -> None:
    """Test the ray against the triangles of a block or patch."""
    origin = frames[IN_SHAPE].origin
    rest = frames[IN_SHAPE].origin_rest
    passed = passed_in_leaf(
        g.blocks, g.patches, leaf, origin, rest, frames[IN_SHAPE].direction, frames[IN_SHAPE].margin
    )
    while passed & 255 != 0:
        j = lowest_bit(passed)
        if (passed >> (WIDTH + j)) & 1 != 0:
            meet_inside(g, held, ray, frames, leaf * WIDTH + j)
        else:
            meet_at_edge(held, ray, frames, leaf * WIDTH + j)
        passed = passed & (passed - 1)


@wp.func
def meet_shape(g: Geometry, held: wp.array[Geometry], ray: wp.array[Ray], frames: wp.array[Frame], shape: int) -> int:
    """Test the ray against a visible closed form, or bring it into the frame of a visible shape with triangles.

    Returns:
        The root of the shape's triangle tree, or NO_CHILD.
    """
    scope = ray[0].world.scope
    pose = pose_at(g, entry_of(g.place, shape, scope))
    to_local = wp.transpose(pose.rotation)
    origin = to_local * (ray[0].world.origin - pose.position)
    direction = to_local * ray[0].world.direction
    kind = g.kind[shape]
    cull = ray[0].world.cull
    if has_triangles(kind):
        if kind == SHEET and cull == CULL_FRONT:
            return NO_CHILD
        frames[IN_SHAPE] = frame_of(origin, direction, g.reach[scope.first_shape + shape])
        ray[0].shape = shape
        ray[0].cull = wp.where(kind == SHEET, CULL_NONE, cull)
        return g.root[scope.first_shape + shape]
    size = g.size[scope.first_shape + shape]
    span = triage_closed_form(kind, size, to_float(origin), to_float(direction), cull)
    offer(held, ray, hit_within(span[0], span[1], shape, 0))
    return NO_CHILD


@wp.func
def cast_at_triangles(
    g: Geometry,
    held: wp.array[Geometry],
    ray: wp.array[Ray],
    frames: wp.array[Frame],
    stack: wp.uint64,
    root: int,
    bottom: int,
) -> None:
    """Find the first hit of a ray in the triangle tree of the shape in whose frame it is."""
    at = root
    top = bottom
    while True:
        limit = smaller(ray[0].best.far * APART, ray[0].world.limit)
        origin = frames[IN_SHAPE].origin
        inverse = frames[IN_SHAPE].inverse
        margin = frames[IN_SHAPE].margin
        nodes = address_of_nodes(g.fours)
        found = next_leaf(nodes, wp.uint64(0), at, origin, inverse, margin, limit, stack, top, bottom, -1)
        top = found[1]
        if found[0] == NO_CHILD:
            break
        meet_leaf(g, held, ray, frames, -1 - found[0])
        at = NO_CHILD


@wp.func
def cast_ray(
    g: Geometry,
    held: wp.array[Geometry],
    ray: wp.array[Ray],
    frames: wp.array[Frame],
    stack: wp.uint64,
    is_cast: bool,
    together: bool,
) -> None:
    """Find the first hit of a ray among the visible shapes; it may lie beyond the limit.

    Args:
        stack: its address.
        is_cast: whether there is a ray; else this thread goes with others of its warp.
        together: whether all rays of the warp are in one span. They come to the shapes that any of them
            enters, as all wait for the slowest anyway.
    """
    span = ray[0].world.scope.span
    visible = address_of_visible(g.visible, ray[0].world.scope.first_visible)
    ray[0].best = no_hit()
    frames[OVER_SHAPES] = frame_of(ray[0].world.origin - g.anchor[span], ray[0].world.direction, g.top_reach[span])
    at = int(span * g.top_count)
    top = int(0)
    credit = wp.where(together, CREDIT, -1)
    while True:
        limit = float(-1.0)
        if is_cast:
            limit = smaller(ray[0].best.far * APART, ray[0].world.limit)
        origin = frames[OVER_SHAPES].origin
        inverse = frames[OVER_SHAPES].inverse
        margin = frames[OVER_SHAPES].margin
        nodes = address_of_nodes(g.top_fours)
        found = next_leaf(nodes, visible, at, origin, inverse, margin, limit, stack, top, 0, credit)
        top = found[1]
        credit = found[2]
        if found[0] == NO_CHILD:
            break
        if is_cast:
            root = meet_shape(g, held, ray, frames, -1 - found[0])
            if root != NO_CHILD:
                cast_at_triangles(g, held, ray, frames, stack, root, top)
        at = NO_CHILD
