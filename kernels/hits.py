"""Which of two hits is the first, and what there is to know about a hit.

A caster works in float32 and knows of each hit an interval, [near, far], that holds its distance. Two hits whose
intervals are apart are in order; where they overlap, `first_of` works both distances out in float64. The first hit of a
ray is thus the same whichever way it is sought: the nearest, of equally near ones that of the lower shape, then of the
lower triangle.
"""

import warp as wp

from .geometry import Geometry, TriangleBlock
from .solids import PLANE, SHEET, closed_form_normal, has_triangles, intersect_closed_form
from .tree import WIDTH
from .triangle import CULL_NONE, decide_triangle, tilted
from .vectors import to_double, to_float

NO_SHAPE = wp.constant(2**31 - 1)
ROUNDING = wp.constant(2.0**-22)
"""Distances to closed forms, float32, that differ by less than this part of themselves count as equal."""


@wp.struct
class WorldRay:
    """A ray in the world, with a unit direction, and what it may hit."""

    origin: wp.vec3d
    direction: wp.vec3d
    limit: float
    cull: int


@wp.struct
class Hit:
    """A hit at a distance of near to far, or NO_SHAPE and +inf."""

    near: float
    far: float
    shape: int
    triangle: int  # block * WIDTH + lane, 0 for closed forms


@wp.func
def no_hit() -> Hit:
    hit = Hit()
    hit.near = wp.inf
    hit.far = wp.inf
    hit.shape = NO_SHAPE
    return hit


@wp.func
def hit_at(t: float, shape: int, triangle: int) -> Hit:
    hit = Hit()
    hit.near = t * (1.0 - ROUNDING)
    hit.far = t * (1.0 + ROUNDING)
    hit.shape = shape
    hit.triangle = triangle
    return hit


@wp.func
def decide_lane(block: TriangleBlock, j: int, origin: wp.vec3d, direction: wp.vec3d, cull: int) -> wp.float64:
    """Distance to one triangle of a block for a ray in its frame, +inf on a miss."""
    v0 = to_double(wp.vec3(block.x0[j], block.y0[j], block.z0[j])) - origin
    v1 = to_double(wp.vec3(block.x1[j], block.y1[j], block.z1[j])) - origin
    v2 = to_double(wp.vec3(block.x2[j], block.y2[j], block.z2[j])) - origin
    return decide_triangle(tilted(direction), v0, v1, v2, cull)


@wp.func
def distance_of(g: Geometry, shape: int, triangle: int, ray: WorldRay) -> wp.float64:
    """Distance to a closed form, or to one triangle of a shape, +inf on a miss."""
    to_local = wp.transpose(g.rotation[shape])
    origin = to_local * (ray.origin - g.position[shape])
    direction = to_local * ray.direction
    kind = g.kind[shape]
    if has_triangles(kind):
        cull = wp.where(kind == SHEET, CULL_NONE, ray.cull)
        return decide_lane(g.blocks[triangle / WIDTH], triangle % WIDTH, origin, direction, cull)
    t = intersect_closed_form(kind, g.size[shape], to_float(origin), to_float(direction), ray.cull)
    return wp.float64(t)


@wp.func
def is_before(g: Geometry, t: wp.float64, a: Hit, t_b: wp.float64, b: Hit) -> bool:
    """Whether hit a at distance t is nearer than b, or as near and of a lower shape, or of a lower triangle of it."""
    if a.shape == b.shape:
        return t < t_b or (t == t_b and a.triangle < b.triangle)
    tie = wp.float64(0.0)
    if not (has_triangles(g.kind[a.shape]) and has_triangles(g.kind[b.shape])):
        tie = wp.float64(ROUNDING) * t
    if wp.abs(t - t_b) > tie:
        return t < t_b
    return a.shape < b.shape


@wp.func
def decided(g: Geometry, best: Hit, hit: Hit, ray: WorldRay) -> Hit:
    """The first of two hits, by their distances in float64."""
    t = distance_of(g, hit.shape, hit.triangle, ray)
    if t == wp.float64(wp.inf):
        return best
    if best.shape != NO_SHAPE:  # noqa: SIM102, as Warp evaluates both sides of an `and`
        if not is_before(g, t, hit, distance_of(g, best.shape, best.triangle, ray), best):
            return best
    return hit_at(float(t), hit.shape, hit.triangle)


@wp.func
def first_of(g: Geometry, best: Hit, hit: Hit, ray: WorldRay) -> Hit:
    if hit.near > best.far or hit.near == wp.inf:
        return best
    if hit.far < best.near:
        return hit
    return decided(g, best, hit, ray)


@wp.func
def hit_distance(g: Geometry, hit: Hit, ray: WorldRay) -> wp.float64:
    """Distance of a hit, +inf beyond the limit."""
    t = distance_of(g, hit.shape, hit.triangle, ray)
    return wp.where(float(t) <= ray.limit, t, wp.float64(wp.inf))


@wp.func
def lane_normal(block: TriangleBlock, j: int) -> wp.vec3:
    return wp.vec3(block.normal_x[j], block.normal_y[j], block.normal_z[j])


@wp.func
def hit_normal(g: Geometry, hit: Hit, distance: wp.float64, ray: WorldRay) -> wp.vec3:
    """Unit outward normal in the world at a hit of the ray."""
    rotation = g.rotation[hit.shape]
    kind = g.kind[hit.shape]
    normal = wp.vec3(0.0, 0.0, 1.0)
    if has_triangles(kind):
        normal = lane_normal(g.blocks[hit.triangle / WIDTH], hit.triangle % WIDTH)
        if kind == SHEET and wp.dot(rotation * to_double(normal), ray.direction) > wp.float64(0.0):
            normal = -normal
    elif kind != PLANE:
        point = ray.origin + distance * ray.direction - g.position[hit.shape]
        normal = closed_form_normal(kind, g.size[hit.shape], to_float(wp.transpose(rotation) * point))
    return to_float(rotation * to_double(normal))


@wp.func
def hit_face(g: Geometry, hit: Hit) -> int:
    """Face of the triangle mesh that was hit, -1 for a closed form."""
    if not has_triangles(g.kind[hit.shape]):
        return -1
    return g.blocks[hit.triangle / WIDTH].face[hit.triangle % WIDTH]
