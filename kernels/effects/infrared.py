"""How bright a depth camera's own light makes a surface, and which pixels are lost for want of light or by chance.

The light sits beside the camera, the surface is Lambertian:

    intensity = rho |n . d| / R^2

with reflectivity rho, normal n, direction d and range R [m]: 1 for a white surface that faces the camera at 1 m.
"""

import warp as wp

from rigcast.kernels.cast import HitArrays
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.vectors import of_ray, to_double

from .draws import Draws, drawn
from .random import RandomSource

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_LOSS = wp.constant(0)  # draws are told apart within a camera's frame: see stereo, kinect_v1, time_of_flight
NEAREST = wp.constant(1.0e-6)


@wp.func
def cos_incidence(normal: wp.vec3, direction: wp.vec3d) -> float:
    """|n . d|, the cosine of the angle between a ray and the normal, 0 to 1."""
    return wp.min(wp.abs(float(wp.dot(to_double(normal), direction))), 1.0)


@wp.func
def returned(reflectivity: float, cosine: float, distance: float) -> float:
    """rho cos / R^2."""
    return reflectivity * cosine / wp.max(distance * distance, NEAREST)


@wp.kernel
def intensity_of_hits(
    first: int,
    reflectivity: wp.array[float],
    directions: wp.array[wp.vec3d],
    distance: wp.array[float],
    shape: wp.array[int],
    normal: wp.array[wp.vec3],
    # out:
    intensity: wp.array[float],
) -> None:
    i = first + wp.tid()
    intensity[i] = 0.0
    if shape[i] >= 0:
        cosine = cos_incidence(normal[i], of_ray(directions, i))
        intensity[i] = returned(reflectivity[shape[i]], cosine, distance[i])


def infrared(hits: HitArrays, directions: wp.array, reflectivity: wp.array, out: wp.array | None = None) -> wp.array:
    """(n,) float32 [1/m^2] intensity of each hit, 0 where there is none.

    Args:
        hits: with normals in the frame of the directions.
        reflectivity: float per shape, 0 to 1.
    """
    out = wp.empty(hits.distance.size, dtype=float, device=directions.device) if out is None else out
    inputs = [reflectivity, directions, hits.distance, hits.shape, hits.normal]
    launch_over_rays(intensity_of_hits, out.size, inputs, [out], directions.device)
    return out


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
