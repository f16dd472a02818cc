"""What follows from hits and rays: points, z-depths and ids of bodies, written by a cast beside its hits."""

import warp as wp

from rigcast.kernels.rays.arrays import RayArrays, direction_of, origin_of
from rigcast.kernels.vectors import to_float

from .out import Fields, Out


@wp.func
def point_at(origin: wp.vec3d, direction: wp.vec3d, distance: float) -> wp.vec3d:
    """Where a ray ends at this distance, NaN where that is not finite."""
    finite = wp.where(wp.abs(distance) < wp.inf, distance, wp.nan)
    return origin + wp.float64(finite) * direction


@wp.func
def depth_at(direction: wp.vec3d, distance: float) -> float:
    """How far a ray from z = 0 gets along z, below 0 for one that looks backwards; +-inf and NaN as the distance."""
    return wp.where(wp.abs(distance) < wp.inf, float(wp.float64(distance) * direction[2]), distance)


@wp.func
def write_fields(fields: Fields, out: Out, rays: RayArrays, i: int) -> None:
    """Write what follows from the hit of ray i."""
    distance = out.distance[i]
    if fields.points.shape[0] > 0:
        fields.points[i] = to_float(point_at(origin_of(rays, i), direction_of(rays, i), distance))
    if fields.depth.shape[0] > 0:
        fields.depth[i] = depth_at(direction_of(rays, i), distance)
    if fields.body_id.shape[0] > 0:
        fields.body_id[i] = -1
        if out.shape[i] >= 0:
            fields.body_id[i] = fields.body_of_shape[out.shape[i]]
