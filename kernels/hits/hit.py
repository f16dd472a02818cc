"""Which of two hits is the first; distance, face and normal of a hit.

A caster works in float32 and computes for each hit an interval [near, far] that contains its distance, but for
rounding. Two hits whose intervals are disjoint are in order. Otherwise `decided` computes both distances in float64. So
the first hit of a ray does not depend on the way it is found. It is the nearest; of equally near ones, that of the
shape with the lower number; on the same shape, the triangle that faces the ray; then that with the lower number.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.inline import noinline
from rigcast.kernels.poses.scope import Scope, pose_of
from rigcast.kernels.shapes.facets import Facet, facet_at, triangle_at
from rigcast.kernels.shapes.solid_normals import closed_form_normal
from rigcast.kernels.shapes.solids import SHEET, decide_closed_form, has_triangles
from rigcast.kernels.shapes.triangle import CULL_NONE, GRAZING, decide_triangle
from rigcast.kernels.vectors import larger, to_double, to_float

NO_SHAPE = wp.constant(2**31 - 1)
APART = wp.constant(1.0 + 2.0**-22)
"""Distances to two shapes whose ratio is at most this count as equal, unless both shapes have triangles."""


@wp.struct
class WorldRay:
    """A ray in the world with a unit direction, and what it may hit: scope, limit [m], culling."""

    origin: wp.vec3d
    direction: wp.vec3d
    scope: Scope
    limit: float
    cull: int


@wp.struct
class Hit:
    """A hit at a distance in [near, far]; NO_SHAPE at +inf for none."""

    near: float
    far: float
    shape: int
    triangle: int  # its number, as in rigcast.kernels.shapes.facets; 0 for closed forms


@wp.func
def no_hit() -> Hit:
    hit = Hit()
    hit.near = wp.inf
    hit.far = wp.inf
    hit.shape = NO_SHAPE
    return hit


@wp.func
def hit_within(near: float, far: float, shape: int, triangle: int) -> Hit:
    hit = Hit()
    hit.near = near
    hit.far = far
    hit.shape = shape
    hit.triangle = triangle
    return hit


@noinline
def distance_of(g: wp.array[Geometry], shape: int, triangle: int, ray: WorldRay) -> wp.float64:
    """Distance [m], in float64, to a closed form or to one triangle of a shape; +inf on a miss."""
    pose = pose_of(g, shape, ray.scope)
    to_local = wp.transpose(pose.rotation)
    origin = to_local * (ray.origin - pose.position)
    direction = to_local * ray.direction
    kind = g[0].kind[shape]
    if has_triangles(kind):
        cull = wp.where(kind == SHEET, CULL_NONE, ray.cull)
        v = triangle_at(g, triangle)
        return decide_triangle(
            direction, to_double(v.a) - origin, to_double(v.b) - origin, to_double(v.c) - origin, cull
        )
    return decide_closed_form(kind, g[0].size[ray.scope.first_shape + shape], origin, direction, ray.cull)


@wp.func
def meets_back(g: wp.array[Geometry], hit: Hit, ray: WorldRay) -> int:
    """1 if the ray meets the triangle from behind (d . n > 0), else 0."""
    facet = facet_at(g, ray.scope.first_shape + hit.shape, hit.triangle)
    normal = pose_of(g, hit.shape, ray.scope).rotation * facet.normal
    return wp.where(wp.dot(ray.direction, normal) > wp.float64(0.0), 1, 0)


@wp.func
def is_before(g: wp.array[Geometry], t: wp.float64, a: Hit, t_b: wp.float64, b: Hit, ray: WorldRay) -> bool:
    """Whether hit a, at distance t, comes before hit b at t_b, by the order in this module's docstring."""
    if a.shape == b.shape:
        if t != t_b:
            return t < t_b
        behind = meets_back(g, a, ray)
        behind_b = meets_back(g, b, ray)
        return behind < behind_b or (behind == behind_b and a.triangle < b.triangle)
    apart = wp.float64(1.0)
    if not (has_triangles(g[0].kind[a.shape]) and has_triangles(g[0].kind[b.shape])):
        apart = wp.float64(APART)
    if wp.max(t, t_b) > apart * wp.min(t, t_b):
        return t < t_b
    return a.shape < b.shape


@wp.func
def decided(g: wp.array[Geometry], best: Hit, hit: Hit, ray: WorldRay) -> Hit:
    """The first of two hits by their float64 distances. A hit with far = +inf takes its distance from float64."""
    t = distance_of(g, hit.shape, hit.triangle, ray)
    if t == wp.float64(wp.inf):
        return best
    if best.shape != NO_SHAPE:  # noqa: SIM102, as Warp evaluates both sides of an `and`
        if not is_before(g, t, hit, distance_of(g, best.shape, best.triangle, ray), best, ray):
            return best
    if hit.far < wp.inf:
        return hit
    return hit_within(float(t), float(t), hit.shape, hit.triangle)


@wp.func
def is_beyond(hit: Hit, best: Hit) -> bool:
    """Whether a hit is a miss or surely farther away than the best one."""
    return hit.near > best.far * APART or hit.near == wp.inf


@wp.func
def is_sure(hit: Hit, best: Hit) -> bool:
    """Whether a hit is surely nearer than the best one."""
    return hit.far * APART < best.near


@wp.func
def by_itself(ray: WorldRay) -> WorldRay:
    """A copy of the ray to pass to a function that is not inlined; without it the original would be kept in memory."""
    made = WorldRay()
    made.origin = ray.origin
    made.direction = ray.direction
    made.scope = ray.scope
    made.limit = ray.limit
    made.cull = ray.cull
    return made


@wp.struct
class Place:
    """A hit in full: the distance [m], the face of a mesh or -1, and the unit outward normal in the world."""

    distance: float
    face: int
    normal: wp.vec3


@wp.func
def place_of(g: wp.array[Geometry], hit: Hit, ray: WorldRay) -> Place:
    """Distance, face and normal of a hit; there must be one."""
    kind = g[0].kind[hit.shape]
    pose = pose_of(g, hit.shape, ray.scope)
    offset = ray.origin - pose.position
    place = Place()
    if has_triangles(kind):
        facet = facet_at(g, ray.scope.first_shape + hit.shape, hit.triangle)
        normal = pose.rotation * facet.normal
        slope = wp.dot(ray.direction, normal)
        place.distance = larger(float(height_above(facet, normal, offset) / slope), 0.0)
        if wp.abs(slope) * facet.scale <= wp.float64(GRAZING):
            place.distance = float(distance_of(g, hit.shape, hit.triangle, by_itself(ray)))
        place.normal = outward(kind, normal * facet.scale, slope)
        place.face = facet.face
    else:
        place.distance = middle(hit.near, hit.far)
        size = g[0].size[ray.scope.first_shape + hit.shape]
        place.normal = normal_of_closed_form(kind, size, pose.rotation, offset, ray.direction, place.distance)
        place.face = -1
    return place


@wp.func
def height_above(facet: Facet, normal: wp.vec3d, offset: wp.vec3d) -> wp.float64:
    """The height V0 . n - (o - x) . R n; divided by d . R n it is the distance to the facet's plane.

    R and x are the shape's pose. normal: R n, the facet's normal in the world, of any length. offset: o - x. If n was
    rounded to float32, the distance is off by u |P - V0| / |cos|.
    """
    return wp.dot(to_double(facet.corner), facet.normal) - wp.dot(offset, normal)


@wp.func
def outward(kind: int, normal: wp.vec3d, slope: wp.float64) -> wp.vec3:
    """The normal of a triangle; for a sheet, that of the side from which the ray comes."""
    sign = wp.where(kind == SHEET, wp.where(slope > wp.float64(0.0), -1.0, 1.0), 1.0)
    return sign * to_float(normal)


@wp.func
def middle(near: float, far: float) -> float:
    """The distance [m] to a closed form, with an error of at most (far - near) / 2."""
    return larger(0.5 * (near + far), 0.0)  # turns -0 into +0


@wp.func
def normal_of_closed_form(
    kind: int, size: wp.vec3, rotation: wp.mat33d, offset: wp.vec3d, direction: wp.vec3d, distance: float
) -> wp.vec3:
    """Unit outward normal in the world where a ray hits a closed form. offset: as in height_above."""
    to_local = wp.transpose(rotation)
    local = to_local * direction
    point = to_float(to_local * offset + wp.float64(distance) * local)
    normal = closed_form_normal(kind, size, point, to_float(local), distance)
    return to_float(rotation * to_double(normal))
