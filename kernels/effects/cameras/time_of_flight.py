"""Measurement of range by a time-of-flight camera.

A pixel measures the mean of the ranges within it, weighted by the returned light rho |n . d| / R^2; where these ranges
differ it is a "flying pixel". Phase is unambiguous up to the range c / (2 f), where f is the modulation frequency;
larger ranges wrap around.
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
    """Write the reading of each pixel from its sub-rays; see `mix`."""
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
    """One reading per pixel: the mean range of its sub-rays' hits by returned light, with the shape and normal of the
    brightest.

    If no sub-ray hits, distance, shape and normal are those of the first: +inf or NaN, -1, 0. `face` is not written.

    Args:
        hits: sub-ray j of pixel i is entry i * subrays + j; normals in the frame of the directions.
        directions: vec3d, unit, of the sub-rays, of one world or of all.
        reflectivity: (shapes,) float32, 0 to 1.
    """
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
    """Add bias and noise to finite distances and wrap them; see `measure_range`."""
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
    """Add bias and noise to distances R [m], in place: R + bias + bias_per_metre R + N(0, std), modulo `wrap`.

    Distances that are not finite stay. std, bias: [m]. bias_per_metre: [m/m]. wrap: ambiguity range [m], inf for none.
    """
    count, device = hits.distance.size, hits.distance.device
    inputs = [std, bias, bias_per_metre, wrap, drawn(source, DRAW_RANGE, count, device)]
    launch_over_runs(disturb_range, count, inputs, [hits.out()], device)
