"""Intensity of the light that a Lambertian surface returns to a sensor from the sensor's own light source.

With reflectivity rho, normal n, direction d and range R [m], the intensity of a lidar, which corrects for range, is
rho |n . d|. That of a camera is

    intensity = rho |n . d| / R^2

which is 1 for a white surface that faces the camera at 1 m.
"""

import warp as wp

from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import launch_over_rays, launch_over_runs
from rigcast.kernels.rays.arrays import RayArrays, Rays, direction_of
from rigcast.kernels.vectors import of_ray, to_double

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SPEED_OF_LIGHT = 299_792_458.0  # [m/s]
LEAST_SQUARE = wp.constant(1.0e-6)  # [m^2], nearer surfaces return the light of this squared range


@wp.func
def cos_incidence(normal: wp.vec3, direction: wp.vec3d) -> float:
    """The cosine |n . d| of the angle between a ray and the normal, 0 to 1."""
    return wp.min(wp.abs(float(wp.dot(to_double(normal), direction))), 1.0)


@wp.func
def returned(reflectivity: float, cosine: float, distance: float) -> float:
    """The intensity rho cos / R^2 [1/m^2]."""
    return reflectivity * cosine / wp.max(distance * distance, LEAST_SQUARE)


@wp.kernel
def intensity_of_hits(
    first: int, reflectivity: wp.array[float], directions: wp.array[wp.vec3d], hits: Out, intensity: wp.array[float]
) -> None:
    """Write rho |n . d| / R^2 of each hit, 0 on a miss."""
    i = first + wp.tid()
    intensity[i] = 0.0
    if hits.shape[i] >= 0:
        cosine = cos_incidence(hits.normal[i], of_ray(directions, i))
        intensity[i] = returned(reflectivity[hits.shape[i]], cosine, hits.distance[i])


def infrared(hits: HitArrays, directions: wp.array, reflectivity: wp.array, out: wp.array | None = None) -> wp.array:
    """Intensity rho |n . d| / R^2 of each hit, (n,) float32 [1/m^2]; 0 on a miss.

    Args:
        hits: (n,), with normals in the frame of the directions.
        directions: vec3d, unit, of the rays of one world or of all.
        reflectivity: (shapes,) float32, 0 to 1.
        out: array to write to and return; None makes a new one.
    """
    out = wp.empty(hits.distance.size, dtype=float, device=directions.device) if out is None else out
    launch_over_rays(intensity_of_hits, out.size, [reflectivity, directions, hits.out()], [out], directions.device)
    return out


@wp.kernel
def reflected_share(
    first: int,
    run: int,  # rays per thread
    reflectivity: wp.array[float],
    rays: RayArrays,
    hits: Out,
    intensity: wp.array[float],
) -> None:
    """Write rho |n . d| of each hit; 0 on a miss and where the distance is not finite."""
    i = (first + wp.tid()) * run
    end = wp.min(i + run, intensity.shape[0])
    while i < end:
        intensity[i] = 0.0
        if wp.isfinite(hits.distance[i]) and hits.shape[i] >= 0:
            intensity[i] = reflectivity[hits.shape[i]] * cos_incidence(hits.normal[i], direction_of(rays, i))
        i += 1


def intensity(hits: HitArrays, rays: Rays, reflectivity: wp.array, out: wp.array | None = None) -> wp.array:
    """Intensity rho |n . d| of each hit, (n,) float32; 0 on a miss and where the distance is not finite.

    hits: with normals in the rays' frame. reflectivity: (shapes,) float32, 0 to 1. out: as for `infrared`.
    """
    out = wp.empty(hits.distance.size, dtype=float, device=hits.distance.device) if out is None else out
    launch_over_runs(reflected_share, out.size, [reflectivity, rays.arrays, hits.out()], [out], out.device)
    return out
