"""Which pixels of a depth camera give no reading: for want of light, for how a surface lies, or by chance."""

import warp as wp

from rigcast.kernels.effects.draws import Draws, drawn
from rigcast.kernels.effects.light import cos_incidence, returned
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.vectors import of_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_LOSS = wp.constant(0)  # draws are told apart within a camera's frame: see stereo, kinect_v1, time_of_flight


@wp.struct
class Losses:
    """Which pixels are lost: dropout and untextured_dropout are probabilities, the others limits."""

    dropout: float
    untextured_dropout: float
    min_cosine: float
    min_intensity: float


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
    """Make the distance NaN where a pixel is lost. reflectivity, textured: of each shape."""
    count, device = hits.distance.size, directions.device
    inputs = [losses, drawn(source, DRAW_LOSS, count, device), reflectivity, textured, directions]
    launch_over_rays(lose_some, count, inputs, [hits.out()], device)
