"""What a time-of-flight camera makes of the ranges in its pixels.

A pixel measures the mean of the ranges in it, each weighted by the light that returns from there, rho |n . d| / R^2
("flying pixels" where they differ). A phase tells ranges apart only up to c / (2 f), where f is the modulation's
frequency; farther ones wrap.
"""

import warp as wp

from rigcast.kernels.cast import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import launch_over_rays, launch_over_runs
from rigcast.kernels.vectors import of_ray

from .draws import Draws, drawn
from .infrared import cos_incidence, returned
from .random import RandomSource

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_RANGE = wp.constant(4)
BLACKEST = wp.constant(1.0e-6)
SPEED_OF_LIGHT = 299792458.0  # [m/s]


@wp.kernel
def mix_subrays(
    first: int,
    subrays: int,
    reflectivity: wp.array[float],
    directions: wp.array[wp.vec3d],
    ray_distance: wp.array[float],
    ray_shape: wp.array[int],
    ray_normal: wp.array[wp.vec3],
    # out:
    distance: wp.array[float],
    shape: wp.array[int],
    normal: wp.array[wp.vec3],
) -> None:
    i = first + wp.tid()
    light = float(0.0)
    light_times_range = float(0.0)
    most = float(0.0)
    brightest = i * subrays
    for j in range(i * subrays, (i + 1) * subrays):
        if ray_shape[j] >= 0:
            cosine = cos_incidence(ray_normal[j], of_ray(directions, j))
            weight = returned(wp.max(reflectivity[ray_shape[j]], BLACKEST), wp.max(cosine, BLACKEST), ray_distance[j])
            light += weight
            light_times_range += weight * ray_distance[j]
            if weight > most:
                most = weight
                brightest = j
    distance[i] = ray_distance[brightest]
    if light > 0.0:
        distance[i] = light_times_range / light
    shape[i] = ray_shape[brightest]
    normal[i] = ray_normal[brightest]


def mix(rays: HitArrays, directions: wp.array, reflectivity: wp.array, subrays: int) -> HitArrays:
    """One reading per pixel from its sub-rays, which follow each other; shape and normal are the brightest one's."""
    device = directions.device
    out = HitArrays.empty(rays.distance.size // subrays, device)
    inputs = [subrays, reflectivity, directions, rays.distance, rays.shape, rays.normal]
    launch_over_rays(mix_subrays, out.distance.size, inputs, [out.distance, out.shape, out.normal], device)
    return out


@wp.kernel
def disturb_range(
    first: int,
    run: int,  # rays per thread
    std: float,
    bias: float,
    bias_per_metre: float,
    wrap: float,
    draws: Draws,
    out: Out,  # in and out
) -> None:
    i = (first + wp.tid()) * run
    end = wp.min(i + run, out.distance.shape[0])
    while i < end:
        distance = out.distance[i]
        if wp.isfinite(distance):
            distance += bias + bias_per_metre * distance + std * draws.numbers[i][0]
            if wp.isfinite(wrap):
                distance -= wrap * wp.floor(distance / wrap)
            out.distance[i] = distance
        i += 1


def measure_range(
    hits: HitArrays, source: RandomSource, *, std: float, bias: float, bias_per_metre: float, wrap: float
) -> None:
    """Give distances [m] bias, noise and, where `wrap` [m] is finite, the remainder by it, in place."""
    count, device = hits.distance.size, hits.distance.device
    inputs = [std, bias, bias_per_metre, wrap, drawn(source, DRAW_RANGE, count, device)]
    launch_over_runs(disturb_range, count, inputs, [hits.out()], device)
