"""Which pixels of a depth camera give no reading: for want of light, for how a surface lies, or by chance."""

import warp as wp

from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.vectors import of_ray

from .draws import Draws, drawn
from .light import cos_incidence, returned
from .random import RandomSource

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
    shape: wp.array[int],
    normal: wp.array[wp.vec3],
    # in and out:
    distance: wp.array[float],
) -> None:
    i = first + wp.tid()
    if shape[i] < 0 or not wp.isfinite(distance[i]):
        return
    numbers = draws.numbers[i]
    cosine = cos_incidence(normal[i], of_ray(directions, i))
    is_lost = numbers[2] < losses.dropout or cosine < losses.min_cosine
    is_lost = is_lost or (numbers[3] < losses.untextured_dropout and not textured[shape[i]])
    is_dark = returned(reflectivity[shape[i]], cosine, distance[i]) < losses.min_intensity
    if is_lost or is_dark:
        distance[i] = wp.nan


def lose(
    hits: HitArrays, losses: Losses, source: RandomSource, directions: wp.array, tables: tuple[wp.array, wp.array]
) -> None:
    """Make the distance NaN where a pixel is lost. tables: reflectivity and whether it has a texture, per shape."""
    count, device = hits.distance.size, directions.device
    inputs = [losses, drawn(source, DRAW_LOSS, count, device), *tables, directions, hits.shape, hits.normal]
    launch_over_rays(lose_some, count, inputs, [hits.distance], device)
