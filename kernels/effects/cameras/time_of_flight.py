"""What a time-of-flight camera makes of the ranges in its pixels.

A pixel measures the mean of the ranges in it, each weighted by the light that returns from there, rho |n . d| / R^2
("flying pixels" where they differ). A phase tells ranges apart only up to c / (2 f), where f is the modulation's
frequency; farther ones wrap.
"""

import warp as wp

from rigcast.kernels.effects.draws import Draws, drawn
from rigcast.kernels.effects.light import cos_incidence, returned
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import launch_over_rays, launch_over_runs
from rigcast.kernels.vectors import of_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_RANGE = wp.constant(4)
BLACKEST = wp.constant(1.0e-6)


@wp.kernel
def mix_subrays(
    first: int,
    subrays: int,
    reflectivity: wp.array[float],
    directions: wp.array[wp.vec3d],
    hits: Out,
    mixed: Out,
) -> None:
    i = first + wp.tid()
    light = float(0.0)
    light_times_range = float(0.0)
    most = float(0.0)
    brightest = i * subrays
    for j in range(i * subrays, (i + 1) * subrays):
        if hits.shape[j] >= 0:
            cosine = cos_incidence(hits.normal[j], of_ray(directions, j))
            white = wp.max(reflectivity[hits.shape[j]], BLACKEST)
            weight = returned(white, wp.max(cosine, BLACKEST), hits.distance[j])
            light += weight
            light_times_range += weight * hits.distance[j]
            if weight > most:
                most = weight
                brightest = j
    mixed.distance[i] = hits.distance[brightest]
    if light > 0.0:
        mixed.distance[i] = light_times_range / light
    mixed.shape[i] = hits.shape[brightest]
    mixed.normal[i] = hits.normal[brightest]


def mix(hits: HitArrays, directions: wp.array, reflectivity: wp.array, subrays: int) -> HitArrays:
    """One reading per pixel from its sub-rays, which follow each other; shape and normal are the brightest one's."""
    device = directions.device
    mixed = HitArrays.empty(hits.distance.size // subrays, device)
    inputs = [subrays, reflectivity, directions, hits.out()]
    launch_over_rays(mix_subrays, mixed.distance.size, inputs, [mixed.out()], device)
    return mixed


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
