"""One ray through both levels of the geometry: the tree over shapes, and the tree over each shape's triangles.

The ray takes along the best hit so far. Boxes that it enters beyond that hit are skipped, the nearer of several boxes
is opened first. Which of two hits is the first does not depend on the order of the visit.
"""

from collections.abc import Callable
from typing import Any

import warp as wp

from .geometry import Geometry, TriangleBlock
from .solids import PLANE, SHEET, closed_form_normal, has_triangles, intersect_closed_form
from .tree import STACK, WIDTH, Node, vec8
from .triangle import CULL_FRONT, CULL_NONE, UNDECIDED, decide_triangle, larger, smaller, tilted, triage_triangle

NO_SHAPE = wp.constant(2**31 - 1)
MARGIN = wp.constant(4.0 * 2.0**-23)
SMALLEST = wp.constant(1.0e-20)

stack_of_nodes = wp.types.vector(length=STACK, dtype=wp.int32)
stack_of_distances = wp.types.vector(length=STACK, dtype=wp.float32)


@wp.struct
class Hit:
    """The best hit so far; +inf and NO_SHAPE at the start."""

    distance: wp.float64
    shape: int
    triangle: int  # block * WIDTH + lane, 0 for closed forms


@wp.struct
class Ray:
    """A ray in the frame of a tree, and that of the world which it came from."""

    # in the tree's frame:
    exact_origin: wp.vec3d
    exact_direction: wp.vec3d  # tilted
    origin: wp.vec3
    origin_rest: wp.vec3  # what is lost in rounding the origin to float32
    direction: wp.vec3
    inverse: wp.vec3  # 1 / direction, finite
    margin: float  # by which boxes are widened: covers all rounding in box_distances
    shape: int
    # in the world:
    world_origin: wp.vec3d
    world_direction: wp.vec3d
    limit: float
    cull: int


@wp.func
def to_float(a: wp.vec3d) -> wp.vec3:
    return wp.vec3(float(a[0]), float(a[1]), float(a[2]))


@wp.func
def to_double(a: wp.vec3) -> wp.vec3d:
    return wp.vec3d(wp.float64(a[0]), wp.float64(a[1]), wp.float64(a[2]))


@wp.func
def inverse_of(x: float) -> float:
    """1 / x, with x kept off 0, so that 0 * inf cannot arise at the faces of boxes."""
    return 1.0 / wp.where(wp.abs(x) < SMALLEST, SMALLEST, x)


@wp.func
def in_frame_of_tree(ray: Ray, origin: wp.vec3d, direction: wp.vec3d, reach: float) -> Ray:
    """The ray as a tree with coordinates up to reach sees it.

    The margin covers, for a box of centre c and half size h, the roundings of o, c - o, its product with 1 / d, and
    the sums with h: fewer than 8u (|o| + reach) in all, u = 2^-24.
    """
    local = ray
    local.exact_origin = origin
    local.exact_direction = tilted(direction)
    local.origin = to_float(origin)
    local.origin_rest = to_float(origin - to_double(local.origin))
    local.direction = to_float(direction)
    local.inverse = wp.vec3(
        inverse_of(local.direction[0]), inverse_of(local.direction[1]), inverse_of(local.direction[2])
    )
    local.margin = MARGIN * (wp.max(wp.abs(local.origin)) + reach)
    return local


@wp.struct
class Entered:
    """Which boxes of a node a ray enters, bit by bit, and at what distances."""

    children: int
    distance: vec8


@wp.func
def enter_boxes(node: Node, ray: Ray, limit: float) -> Entered:
    """The boxes that the ray enters no farther than the limit."""
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
    margin = ray.margin
    distance = vec8()
    children = int(0)
    for j in range(WIDTH):
        cx = (center_x[j] - origin[0]) * inverse[0]
        cy = (center_y[j] - origin[1]) * inverse[1]
        cz = (center_z[j] - origin[2]) * inverse[2]
        hx = (half_x[j] + margin) * speed[0]
        hy = (half_y[j] + margin) * speed[1]
        hz = (half_z[j] + margin) * speed[2]
        enter = larger(larger(cx - hx, cy - hy), larger(cz - hz, 0.0))
        leave = smaller(smaller(cx + hx, cy + hy), smaller(cz + hz, limit))
        distance[j] = enter
        # the last condition keeps absent children out whatever rays and boxes are: NaN is lost in larger and smaller
        children = children | wp.where(enter <= leave and half_x[j] >= 0.0, 1 << j, 0)
    entered = Entered()
    entered.children = children
    entered.distance = distance
    return entered


@wp.func
def lowest_bit(mask: int) -> int:
    """Index of the lowest bit that is set, of eight."""
    bit = mask & -mask
    return wp.where(bit & 170 != 0, 1, 0) + wp.where(bit & 204 != 0, 2, 0) + wp.where(bit & 240 != 0, 4, 0)


@wp.func
def is_before(a: Hit, b: Hit) -> bool:
    """Whether hit a is nearer, or as near and of a lower shape, or of the same and a lower triangle."""
    if a.distance != b.distance:
        return a.distance < b.distance
    if a.shape != b.shape:
        return a.shape < b.shape
    return a.triangle < b.triangle


@wp.func
def first_of(best: Hit, hit: Hit, limit: float) -> Hit:
    """The first of two hits, where one beyond the limit does not count."""
    if float(hit.distance) <= limit and float(hit.distance) < wp.inf and is_before(hit, best):
        return hit
    return best


def traversal(name: str, visit_leaf: Callable[..., Any]) -> Any:
    """A Warp function that takes a ray through a tree and shows it every leaf that may hold a better hit."""

    def traverse(g: Geometry, visible: wp.array[wp.bool], nodes: wp.array[Node], root: int, ray: Ray, best: Hit) -> Hit:
        stack = stack_of_nodes()
        distance = stack_of_distances()
        stack[0] = root
        top = int(1)
        while top > 0:
            top -= 1
            at = stack[top]
            if distance[top] <= float(best.distance):
                if at < 0:
                    best = visit_leaf(g, visible, -1 - at, ray, best)
                else:
                    entered = enter_boxes(nodes[at], ray, smaller(float(best.distance), ray.limit))
                    children = entered.children
                    floor = top
                    while children != 0:
                        j = lowest_bit(children)
                        children = children & (children - 1)
                        # insert where the farther ones are below
                        k = int(top)
                        while k > floor and distance[wp.max(k - 1, 0)] < entered.distance[j]:
                            distance[k] = distance[k - 1]
                            stack[k] = stack[k - 1]
                            k -= 1
                        distance[k] = entered.distance[j]
                        stack[k] = nodes[at].child[j]
                        top += 1
        return best

    traverse.__name__ = traverse.__qualname__ = name
    return wp.func(traverse)


@wp.func
def triage_block(block: TriangleBlock, ray: Ray) -> vec8:
    """Distances to the triangles of a block, or what else triage_triangle says."""
    x0 = block.x0
    y0 = block.y0
    z0 = block.z0
    x1 = block.x1
    y1 = block.y1
    z1 = block.z1
    x2 = block.x2
    y2 = block.y2
    z2 = block.z2
    normal_x = block.normal_x
    normal_y = block.normal_y
    normal_z = block.normal_z
    origin = ray.origin
    rest = ray.origin_rest
    direction = ray.direction
    cull = ray.cull
    distance = vec8()
    for j in range(WIDTH):
        a = wp.vec3(x0[j], y0[j], z0[j])
        b = wp.vec3(x1[j], y1[j], z1[j])
        c = wp.vec3(x2[j], y2[j], z2[j])
        # vertices as seen from the ray's origin, to within 2u of the difference
        v0 = (a - origin) - rest
        v1 = (b - origin) - rest
        v2 = (c - origin) - rest
        normal = wp.vec3(normal_x[j], normal_y[j], normal_z[j])
        distance[j] = triage_triangle(direction, a - b, b - c, c - a, v0, v1, v2, normal, cull)
    return distance


@wp.func
def decide_lane(block: TriangleBlock, j: int, ray: Ray) -> wp.float64:
    """Distance to one triangle of a block, +inf on a miss."""
    v0 = to_double(wp.vec3(block.x0[j], block.y0[j], block.z0[j])) - ray.exact_origin
    v1 = to_double(wp.vec3(block.x1[j], block.y1[j], block.z1[j])) - ray.exact_origin
    v2 = to_double(wp.vec3(block.x2[j], block.y2[j], block.z2[j])) - ray.exact_origin
    return decide_triangle(ray.exact_direction, v0, v1, v2, ray.cull)


@wp.func
def lane_normal(block: TriangleBlock, j: int) -> wp.vec3:
    return wp.vec3(block.normal_x[j], block.normal_y[j], block.normal_z[j])


@wp.func
def visit_block(g: Geometry, visible: wp.array[wp.bool], index: int, ray: Ray, best: Hit) -> Hit:  # noqa: ARG001
    """The ray against the triangles of one block."""
    block = g.blocks[index]
    distance = triage_block(block, ray)
    for j in range(WIDTH):
        if distance[j] <= float(best.distance) and distance[j] < wp.inf:
            hit = Hit()
            hit.distance = wp.float64(distance[j])
            hit.shape = ray.shape
            hit.triangle = index * WIDTH + j
            if distance[j] == UNDECIDED:
                hit.distance = decide_lane(block, j, ray)
            best = first_of(best, hit, ray.limit)
    return best


cast_through_triangles = traversal("cast_through_triangles", visit_block)


@wp.func
def visit_shape(g: Geometry, visible: wp.array[wp.bool], shape: int, ray: Ray, best: Hit) -> Hit:
    """The ray against one shape, if it is visible."""
    if not visible[shape]:
        return best
    to_local = wp.transpose(g.rotation[shape])
    origin = to_local * (ray.world_origin - g.position[shape])
    direction = to_local * ray.world_direction
    kind = g.kind[shape]
    if kind == SHEET and ray.cull == CULL_FRONT:
        return best
    if has_triangles(kind):
        local = in_frame_of_tree(ray, origin, direction, g.reach[shape])
        local.shape = shape
        local.cull = wp.where(kind == SHEET, CULL_NONE, ray.cull)
        return cast_through_triangles(g, visible, g.nodes, g.root[shape], local, best)
    t = intersect_closed_form(kind, g.size[shape], to_float(origin), to_float(direction), ray.cull)
    hit = Hit()
    hit.distance = wp.float64(t)
    hit.shape = shape
    return first_of(best, hit, ray.limit)


cast_through_shapes = traversal("cast_through_shapes", visit_shape)


@wp.func
def cast_ray(
    g: Geometry, visible: wp.array[wp.bool], origin: wp.vec3d, direction: wp.vec3d, limit: float, cull: int
) -> Hit:
    """The first hit of a world ray with a unit direction among the visible shapes, no farther than limit."""
    best = Hit()
    best.distance = wp.float64(wp.inf)
    best.shape = NO_SHAPE
    ray = Ray()
    ray.limit = limit
    ray.world_origin = origin
    ray.world_direction = direction
    ray.cull = cull
    ray = in_frame_of_tree(ray, origin - g.anchor[0], direction, g.top_reach[0])
    return cast_through_shapes(g, visible, g.top, 0, ray, best)


@wp.func
def hit_normal(g: Geometry, hit: Hit, origin: wp.vec3d, direction: wp.vec3d) -> wp.vec3:
    """Unit outward normal in the world at a hit of the ray."""
    rotation = g.rotation[hit.shape]
    kind = g.kind[hit.shape]
    normal = wp.vec3(0.0, 0.0, 1.0)
    if has_triangles(kind):
        normal = lane_normal(g.blocks[hit.triangle / WIDTH], hit.triangle % WIDTH)
        if kind == SHEET and wp.dot(rotation * to_double(normal), direction) > wp.float64(0.0):
            normal = -normal
    elif kind != PLANE:
        point = origin + hit.distance * direction - g.position[hit.shape]
        normal = closed_form_normal(kind, g.size[hit.shape], to_float(wp.transpose(rotation) * point))
    return to_float(rotation * to_double(normal))


@wp.func
def hit_face(g: Geometry, hit: Hit) -> int:
    """Face of the triangle mesh that was hit, -1 for a closed form."""
    if not has_triangles(g.kind[hit.shape]):
        return -1
    return g.blocks[hit.triangle / WIDTH].face[hit.triangle % WIDTH]
