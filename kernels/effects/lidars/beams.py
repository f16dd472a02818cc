"""Directions of a lidar's light: beams with angular noise, and sub-rays spread over the beam's divergence.

A direction d is deflected sideways and upwards by small angles a = (a_h, a_v) [rad]:

    d' = cos |a| d + sin |a| (a_h h + a_v v) / |a|,   h = z x d / |z x d|,   v = d x h

with z the up axis of the sensor's frame. With S sub-rays per beam, sub-ray s of beam i is ray i S + s.
"""

import math

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.effects.draws import Draws, drawn
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.vectors import of_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_ANGLE = wp.constant(0)
NEARLY_VERTICAL = wp.constant(wp.float64(1.0e-9))


def hexagonal_rings(rings: int, width: tuple[float, float]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Sub-rays over the cross-section of a Gaussian beam: one in the middle, 6 k on ring k.

    width: full widths (across, up) [rad] at which the irradiance exp(-2 r^2) has fallen to 1 / e^2 of that in the
    middle. Ring k has radius k / (rings + 1/2) of the half widths, so that the sub-rays of all rings represent equal
    areas, and the one in the middle 3/4 of that.

    Returns:
        Angles (n, 2) float32 [rad], the middle first, and weights (n,) float32 with sum 1.
    """
    ring = np.concatenate([[0], *(np.full(6 * k, k) for k in range(1, rings + 1))])
    turn = np.concatenate([[0.0], *(np.arange(6 * k) * (math.pi / (3 * k)) for k in range(1, rings + 1))])
    radius = ring / (rings + 0.5)
    angles = 0.5 * np.array(width) * radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    weights = np.exp(-2 * radius**2)
    return angles.astype(np.float32), (weights / weights.sum()).astype(np.float32)


@wp.func
def horizontal_of(d: wp.vec3d) -> wp.vec3d:
    """The unit vector h = z x d / |z x d|; +y if d is along z."""
    across = wp.sqrt(d[0] * d[0] + d[1] * d[1])
    if across < NEARLY_VERTICAL:
        return wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
    return wp.vec3d(-d[1] / across, d[0] / across, wp.float64(0.0))


@wp.func
def turned(d: wp.vec3d, h: wp.vec3d, v: wp.vec3d, angles: wp.vec2) -> wp.vec3d:
    """The direction d deflected by angles (a_h, a_v) [rad], by this module's equation."""
    side = wp.float64(angles[0]) * h + wp.float64(angles[1]) * v
    angle = wp.length(side)
    if angle == wp.float64(0.0):
        return d
    return wp.cos(angle) * d + wp.sin(angle) / angle * side


@wp.kernel
def aim_beams(
    first: int,
    directions: wp.array[wp.vec3d],
    spread: wp.array[wp.vec2],
    # noise:
    angle_std: float,
    draws: Draws,  # empty without noise
    # out, spread.size for each direction:
    aimed: wp.array[wp.vec3d],
) -> None:
    """Write the directions of all sub-rays of each beam, with the same noise for the sub-rays of a beam."""
    i = first + wp.tid()
    d = of_ray(directions, i)
    h = horizontal_of(d)
    v = wp.cross(d, h)
    noise = wp.vec2(0.0, 0.0)
    if angle_std > 0.0:
        numbers = draws.numbers[i]
        noise = angle_std * wp.vec2(numbers[0], numbers[1])
    for s in range(spread.shape[0]):
        aimed[i * spread.shape[0] + s] = turned(d, h, v, noise + spread[s])


@wp.kernel
def repeat_origins(first: int, origins: wp.array[wp.vec3d], times: int, repeated: wp.array[wp.vec3d]) -> None:
    i = first + wp.tid()
    repeated[i] = origins[i / times]


def aim(rays: Rays, spread: wp.array, source: RandomSource, angle_std: float, worlds: int = 1) -> wp.array:
    """Unit directions (worlds n S,) vec3d of the S sub-rays of n rays, in the rays' frame.

    spread: (S,) vec2 [rad], deflection of each sub-ray. angle_std: standard deviation of the noise of a_h and of a_v
    [rad].
    """
    count, device = worlds * rays.directions.size, rays.directions.device
    aimed = wp.empty(count * spread.size, dtype=wp.vec3d, device=device)
    draws = drawn(source, DRAW_ANGLE, count if angle_std > 0 else 0, device)
    launch_over_rays(aim_beams, count, [rays.directions, spread, angle_std, draws], [aimed], device)
    return aimed


def repeated(origins: wp.array, times: int) -> wp.array:
    """Origins (n times,), each repeated `times` times in a row; a single origin, for all rays, stays single."""
    if origins.size == 1 or times == 1:
        return origins
    out = wp.empty(origins.size * times, dtype=wp.vec3d, device=origins.device)
    launch_over_rays(repeat_origins, out.size, [origins, times], [out], out.device)
    return out
