"""The cast: rays that stand in a frame, through the geometry, to hits."""

from dataclasses import dataclass

import warp as wp

from .geometry import FARTHEST, Geometry
from .hits import NO_SHAPE, WorldRay, hit_distance, hit_face, hit_normal
from .launch import launch_over_rays
from .ray import cast_ray
from .vectors import to_double

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@dataclass(frozen=True)
class Rays:
    """Rays in a frame, as Warp arrays on one device.

    directions: (n,) vec3d, unit. origins: (n,) vec3d [m], or (1,) for all rays.
    position, rotation: (1,) vec3d [m] and mat33d, the frame's pose in the world; columns are its axes.
    """

    directions: wp.array
    origins: wp.array
    position: wp.array
    rotation: wp.array


@dataclass(frozen=True)
class HitArrays:
    """What a cast writes, one entry per ray.

    distance: float32 [m], +inf on a miss, NaN for a ray that is not finite or starts beyond FARTHEST.
    shape, face: int32, -1 on a miss. normal: vec3, unit, outward, in the world; 0 on a miss.
    """

    distance: wp.array
    shape: wp.array
    face: wp.array
    normal: wp.array

    @staticmethod
    def empty(count: int, device: wp.DeviceLike) -> "HitArrays":
        return HitArrays(
            wp.empty(count, dtype=float, device=device),
            wp.empty(count, dtype=int, device=device),
            wp.empty(count, dtype=int, device=device),
            wp.empty(count, dtype=wp.vec3, device=device),
        )


@wp.func
def is_castable(ray: WorldRay) -> bool:
    near_enough = wp.max(wp.abs(ray.origin)) <= wp.float64(FARTHEST)
    return wp.isfinite(ray.origin) and wp.isfinite(ray.direction) and near_enough


@wp.kernel
def cast_rays(
    first: int,
    # scene:
    g: Geometry,
    visible: wp.array[wp.bool],
    # rays:
    directions: wp.array[wp.vec3d],
    origins: wp.array[wp.vec3d],
    position: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    limit: float,
    cull: int,
    # out:
    distance: wp.array[float],
    shape: wp.array[int],
    face: wp.array[int],
    normal: wp.array[wp.vec3],
) -> None:
    i = first + wp.tid()
    ray = WorldRay()
    ray.origin = position[0] + rotation[0] * origins[wp.min(i, origins.shape[0] - 1)]
    ray.direction = rotation[0] * directions[i]
    ray.limit = limit
    ray.cull = cull
    distance[i] = wp.inf
    shape[i] = -1
    face[i] = -1
    normal[i] = wp.vec3(0.0, 0.0, 0.0)
    if not is_castable(ray):
        distance[i] = wp.nan
        return
    hit = cast_ray(g, visible, ray)
    if hit.shape != NO_SHAPE:
        t = hit_distance(g, hit, ray)
        if t < wp.float64(wp.inf):
            distance[i] = float(t)
            shape[i] = hit.shape
            face[i] = hit_face(g, hit)
            normal[i] = hit_normal(g, hit, t, ray)


def cast(geometry: Geometry, visible: wp.array, rays: Rays, limit: float, cull: int) -> HitArrays:
    """Each ray's first hit among the visible shapes, up to and including limit [m].

    Args:
        visible: bool per shape.
        cull: CULL_NONE, CULL_BACK or CULL_FRONT of rigcast.kernels.triangle.
    """
    device = rays.directions.device
    out = HitArrays.empty(rays.directions.size, device)
    launch_over_rays(
        cast_rays,
        rays.directions.size,
        [geometry, visible, rays.directions, rays.origins, rays.position, rays.rotation, limit, cull],
        [out.distance, out.shape, out.face, out.normal],
        device,
    )
    return out


@wp.kernel
def widen(narrow: wp.array[wp.vec3], wide: wp.array[wp.vec3d]) -> None:
    i = wp.tid()
    wide[i] = to_double(narrow[i])


@wp.kernel
def normalize(vectors: wp.array[wp.vec3d], unit: wp.array[wp.vec3d]) -> None:
    i = wp.tid()
    # scaled by the largest component first: squares of 1e-200 would vanish, those of 1e200 overflow
    scaled = vectors[i] / wp.max(wp.abs(vectors[i]))
    unit[i] = scaled / wp.length(scaled)


def as_double(vectors: wp.array) -> wp.array:
    """(n,) vec3d of (n,) vec3 or vec3d."""
    if vectors.dtype == wp.vec3d:
        return vectors
    wide = wp.empty(vectors.size, dtype=wp.vec3d, device=vectors.device)
    wp.launch(widen, vectors.size, inputs=[vectors], outputs=[wide], device=vectors.device)
    return wide


def unit_directions(vectors: wp.array) -> wp.array:
    """(n,) vec3d of length 1, NaN where (n,) vec3 or vec3d vectors have none."""
    unit = wp.empty(vectors.size, dtype=wp.vec3d, device=vectors.device)
    wp.launch(normalize, vectors.size, inputs=[as_double(vectors)], outputs=[unit], device=vectors.device)
    return unit
