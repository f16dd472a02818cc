"""Pixels of a depth camera that give no reading: too little light, too oblique a surface, or by chance."""

import warp as wp

from rigcast.kernels.effects.draws import Draws, drawn
from rigcast.kernels.effects.light import cos_incidence, returned
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.vectors import of_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_LOSS = wp.constant(0)  # unique among the draws of a camera's frame: see stereo, kinect_v1, time_of_flight


@wp.struct
class Losses:
    """Conditions under which a pixel is lost."""

    dropout: float  # probability for any pixel
    untextured_dropout: float  # further probability on an untextured shape
    min_cosine: float  # least |n . d|
    min_intensity: float  # least rho |n . d| / R^2 [1/m^2]


@wp.kernel
def lose_some(
    first: int,
    losses: Losses,
    draws: Draws,
    reflectivity: wp.array[float],
    textured: wp.array[wp.bool],
    directions: wp.array[wp.vec3d],
    hits: Out,  # distance in and out
) -> None:
    """Set the distance of lost pixels to NaN; pixels without a hit are left as they are."""
    i = first + wp.tid()
    shape = hits.shape[i]
    distance = hits.distance[i]
    if shape < 0 or not wp.isfinite(distance):
        return
    numbers = draws.numbers[i]
    cosine = cos_incidence(hits.normal[i], of_ray(directions, i))
    is_lost = numbers[2] < losses.dropout or cosine < losses.min_cosine
    is_lost = is_lost or (numbers[3] < losses.untextured_dropout and not textured[shape])
    is_dark = returned(reflectivity[shape], cosine, distance) < losses.min_intensity
    if is_lost or is_dark:
        hits.distance[i] = wp.nan


def lose(
    hits: HitArrays,
    losses: Losses,
    source: RandomSource,
    directions: wp.array,
    reflectivity: wp.array,
    textured: wp.array,
) -> None:
    """Set the distance of lost pixels to NaN, in place; pixels without a hit are left as they are.

    Args:
        hits: (n,), with normals in the frame of the directions.
        directions: vec3d, unit, of the rays of one world or of all.
        reflectivity: (shapes,) float32, 0 to 1.
        textured: (shapes,) bool.
    """
    count, device = hits.distance.size, directions.device
    inputs = [losses, drawn(source, DRAW_LOSS, count, device), reflectivity, textured, directions]
    launch_over_rays(lose_some, count, inputs, [hits.out()], device)
