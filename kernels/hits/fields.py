"""Fields derived from hits and rays, written by a cast beside its hits: points, z-depths and body ids."""

import warp as wp

from rigcast.kernels.rays.arrays import RayArrays, direction_of, origin_of
from rigcast.kernels.vectors import to_float

from .out import Fields, Out


@wp.func
def point_at(origin: wp.vec3d, direction: wp.vec3d, distance: float) -> wp.vec3d:
    """The end of a ray at this distance [m]; NaN if the distance is not finite."""
    finite = wp.where(wp.abs(distance) < wp.inf, distance, wp.nan)
    return origin + wp.float64(finite) * direction


@wp.func
def depth_at(direction: wp.vec3d, distance: float) -> float:
    """The z coordinate [m] of the end of a ray from z = 0, negative if it looks backwards; +-inf or NaN if the distance
    is."""
    return wp.where(wp.abs(distance) < wp.inf, float(wp.float64(distance) * direction[2]), distance)


@wp.func
def write_fields(fields: Fields, out: Out, rays: RayArrays, i: int) -> None:
    """Write the derived fields of ray i."""
    distance = out.distance[i]
    if fields.points.shape[0] > 0:
        fields.points[i] = to_float(point_at(origin_of(rays, i), direction_of(rays, i), distance))
    if fields.depth.shape[0] > 0:
        fields.depth[i] = depth_at(direction_of(rays, i), distance)
    if fields.body_id.shape[0] > 0:
        fields.body_id[i] = -1
        if out.shape[i] >= 0:
            fields.body_id[i] = fields.body_of_shape[out.shape[i]]
