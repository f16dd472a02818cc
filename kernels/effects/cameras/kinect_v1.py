"""Measurement error of the first Kinect at depth z [m], by two models.

Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking" (3DIMPVT 2012),
with theta the angle between the surface's normal and the ray. (They tilted a board in the middle of the image, where
the ray is the camera's axis. For a floor below a level camera the angle to the axis would be meaningless.)

    sigma_z = 0.0012 + 0.0019 (z - 0.4)^2 + (0.0001 / sqrt z) theta^2 / (pi/2 - theta)^2     [m]
    sigma_l = 0.8 + 0.035 theta / (pi/2 - theta)                                             [pixels], across and down

Barron and Malik, "Intrinsic scene properties from a single RGB-D image" (CVPR 2013), as Handa et al. (ICRA 2014) and
Bohg et al. round it: pixels shifted by N(0, 1/2) pixels across and down, and a disparity in eighths of a pixel,

    z' = 35130 / round(35130 / round(100 z) + N(0, 1/6) + 1/2) / 100

with N(m, s) a normal distribution of mean m and standard deviation s. A pixel is shifted by casting its ray again in
another direction.
"""

import warp as wp

from rigcast.kernels.effects.draws import Draws, drawn
from rigcast.kernels.effects.light import cos_incidence
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.vectors import of_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_SHIFT = wp.constant(2)
DRAW_DEPTH = wp.constant(3)
HALF_PI = wp.constant(1.5707963267948966)
NGUYEN = wp.constant(0)
DISPARITY = wp.constant(1)
EIGHTHS = wp.constant(35130.0)  # disparity in eighths of a pixel times depth in centimetres


@wp.func
def incidence(normal: wp.vec3, direction: wp.vec3d) -> float:
    """The angle theta [rad] between a ray and the surface's normal, 0 to pi / 2; 0 on a miss."""
    return wp.where(wp.length_sq(normal) > 0.0, wp.acos(cos_incidence(normal, direction)), 0.0)


@wp.func
def ray_through(directions: wp.array[wp.vec3d], width: int, height: int, u: float, v: float) -> wp.vec3d:
    """Unit direction through the image point (u, v) [pixels], interpolated bilinearly between pixel centres.

    Points outside the centres of the outermost pixels are clamped to these.
    """
    across = wp.clamp(u, 0.0, float(width - 1))
    down = wp.clamp(v, 0.0, float(height - 1))
    u0 = wp.min(int(across), wp.max(width - 2, 0))
    v0 = wp.min(int(down), wp.max(height - 2, 0))
    u1 = wp.min(u0 + 1, width - 1)
    v1 = wp.min(v0 + 1, height - 1)
    a = wp.float64(across - float(u0))
    b = wp.float64(down - float(v0))
    upper = wp.lerp(directions[v0 * width + u0], directions[v0 * width + u1], a)
    lower = wp.lerp(directions[v1 * width + u0], directions[v1 * width + u1], a)
    return wp.normalize(wp.lerp(upper, lower, b))


@wp.kernel
def shift_pixels(
    first: int,
    model: int,
    width: int,
    height: int,
    draws: Draws,
    directions: wp.array[wp.vec3d],
    normal: wp.array[wp.vec3],
    # out:
    shifted: wp.array[wp.vec3d],
) -> None:
    """Write the unit direction of each pixel's ray after its lateral error, N(0, sigma) pixels across and down."""
    i = first + wp.tid()
    sigma = float(0.5)
    if model == NGUYEN:
        theta = incidence(normal[i], of_ray(directions, i))
        sigma = 0.8 + 0.035 * theta / wp.max(HALF_PI - theta, 1.0e-6)
    shift = draws.numbers[i]
    pixel = i % (width * height)
    u = float(pixel % width) + sigma * shift[0]
    v = float(pixel / width) + sigma * shift[1]
    shifted[i] = ray_through(directions, width, height, u, v)


def shift(model: int, size: tuple[int, int], source: RandomSource, directions: wp.array, normal: wp.array) -> wp.array:
    """Unit directions (n,) vec3d of an image's rays, shifted by the model's lateral error.

    Args:
        model: NGUYEN or DISPARITY.
        size: (width, height) [pixels]; n is width * height for each world.
        directions: (width * height,) vec3d, unit, of the pixels, row by row.
        normal: (n,) of the surfaces hit, in the frame of the directions, 0 on a miss; used by NGUYEN.
    """
    out = wp.empty(normal.size, dtype=wp.vec3d, device=directions.device)
    draws = drawn(source, DRAW_SHIFT, out.size, out.device)
    launch_over_rays(shift_pixels, out.size, [model, *size, draws, directions, normal], [out], out.device)
    return out


@wp.kernel
def keep_depth(
    first: int,
    shifted: wp.array[wp.vec3d],
    directions: wp.array[wp.vec3d],
    # in and out:
    distance: wp.array[float],
) -> None:
    """Scale distances along shifted rays to the same depth along the pixels' own rays."""
    i = first + wp.tid()
    distance[i] = distance[i] * float(shifted[i][2] / of_ray(directions, i)[2])


def at_own_pixel(distance: wp.array, shifted: wp.array, directions: wp.array) -> None:
    """Convert distances [m] along shifted rays to distances along the pixels' own rays at the same depth, in place.

    Distances that are not finite stay so.
    """
    launch_over_rays(keep_depth, distance.size, [shifted, directions], [distance], directions.device)


@wp.func
def nguyen_sigma(z: float, theta: float) -> float:
    """sigma_z [m] of Nguyen's model at depth z [m] and angle theta [rad]."""
    from_normal = theta / wp.max(HALF_PI - theta, 1.0e-6)
    return 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4) + 0.0001 / wp.sqrt(z) * from_normal * from_normal


@wp.kernel
def disturb_depth(
    first: int,
    model: int,
    draws: Draws,
    directions: wp.array[wp.vec3d],
    normal: wp.array[wp.vec3],
    # in and out:
    distance: wp.array[float],
) -> None:
    """Add the model's depth error to finite distances with z > 0; others are left as they are."""
    i = first + wp.tid()
    direction = of_ray(directions, i)
    along = float(direction[2])
    z = distance[i] * along
    if not (wp.isfinite(distance[i]) and z > 0.0):
        return
    chance = draws.numbers[i][0]
    measured = float(0.0)
    if model == NGUYEN:
        measured = z + nguyen_sigma(z, incidence(normal[i], direction)) * chance
    else:
        centimetres = wp.max(wp.round(100.0 * z), 1.0)
        measured = 0.01 * EIGHTHS / wp.round(EIGHTHS / centimetres + chance / 6.0 + 0.5)
    distance[i] = measured / along


def measure_depth(model: int, source: RandomSource, directions: wp.array, normal: wp.array, distance: wp.array) -> None:
    """Add the model's error in depth to distances (n,) [m], in place; those not finite, or with z <= 0, stay.

    model: NGUYEN or DISPARITY. directions, normal: as for `shift`; the normals are used by NGUYEN.
    """
    inputs = [model, drawn(source, DRAW_DEPTH, distance.size, distance.device), directions, normal]
    launch_over_rays(disturb_depth, distance.size, inputs, [distance], distance.device)
