"""Measurement of depth by a stereo camera.

With focal length f [pixels] and baseline B [m], a point at depth z has the disparity d = f |B| / z between the camera
and the second imager, or projector, at (B, 0, 0) in the optical frame. The camera

- does not match points hidden from the second imager: a ray from there to the point meets something before it;
- matches windows, so that a foreground's edge grows into the background by half a window ("foreground fattening":
  Scharstein and Szeliski, IJCV 47, 2002, sec. 5);
- measures d with an error of standard deviation s [pixels], which is sigma_z = z^2 s / (f |B|) in depth; rounds it to
  steps; and finds no surface nearer than the depth of a greatest disparity.
"""

from dataclasses import dataclass

import warp as wp

from rigcast.kernels.effects.draws import Draws, drawn
from rigcast.kernels.effects.light import cos_incidence
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import launch_over_rays, launch_over_runs
from rigcast.kernels.packing.steered import steered
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.vectors import of_ray, to_double, to_float

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DRAW_DISPARITY = wp.constant(1)
EDGE = wp.constant(1.0)  # disparity [pixels] by which a pixel must be in front of a surface to be an edge
SAME_SURFACE = wp.constant(1.0e-4)  # tolerance over (1 + t) / |cos|: at least 4 times the error of two casts to a point


@wp.struct
class StereoPair:
    """Geometry of a stereo pair: image width and height, focal length fx and principal point cx [pixels], signed
    baseline [m]."""

    width: int
    height: int
    focal: float
    centre: float
    baseline: float


@wp.struct
class Lines:
    """Rays with directions per ray of each world, or of one world for all, and the distance [m] of each."""

    directions: wp.array[wp.vec3d]
    distance: wp.array[float]


def lines_of(directions: wp.array, distance: wp.array) -> Lines:
    """Lines of these arrays. A struct, because Warp compiles a kernel twice if arrays are its arguments."""
    lines = Lines()
    lines.directions, lines.distance = directions.flatten(), distance
    return lines


@wp.func
def depth_of_disparity(pair: StereoPair, disparity: float) -> float:
    """Depth z = f |B| / d [m] of a disparity [pixels], or the disparity of a depth."""
    return pair.focal * wp.abs(pair.baseline) / disparity


@wp.kernel
def look_from_second(first: int, baseline: float, seen: Lines, second: Lines) -> None:
    """Write rays from the second imager to the points of `seen`, with their lengths.

    Where the distance is not finite, the ray keeps its direction and its length is +inf.
    """
    i = first + wp.tid()
    direction = of_ray(seen.directions, i)
    distance = seen.distance[i]
    second.directions[i] = direction
    second.distance[i] = wp.inf
    if wp.isfinite(distance):
        point = wp.float64(distance) * direction
        offset = point - wp.vec3d(wp.float64(baseline), wp.float64(0.0), wp.float64(0.0))
        second.directions[i] = offset / wp.length(offset)
        second.distance[i] = float(wp.length(offset))


@wp.kernel
def hide_unseen(first: int, pair: StereoPair, second: Lines, met: Out, hits: Out) -> None:
    """Set the distance of hits that the second imager does not see to NaN.

    second: rays from the second imager to the hits. met: their hits. A hit is not seen if its ray meets something
    nearer, or if it is outside the second image, which is as wide as the first.
    """
    i = first + wp.tid()
    if not wp.isfinite(hits.distance[i]):
        return
    ray = second.directions[i]
    length = second.distance[i]
    column = pair.focal * float(ray[0] / ray[2]) + pair.centre
    is_in_picture = ray[2] > wp.float64(0.0) and column >= 0.0 and column <= float(pair.width)
    # the error of a distance grows as 1 / |cos|
    slack = SAME_SURFACE * (1.0 + length) / wp.max(cos_incidence(hits.normal[i], ray), 1.0e-3)
    if met.distance[i] < length - slack or not is_in_picture:
        hits.distance[i] = wp.nan


@dataclass(frozen=True)
class SecondView:
    """Rays from the second imager to the camera's hits, and their lengths [m], +inf where there is no hit."""

    rays: Rays
    length: wp.array


def second_view(hits: HitArrays, rays: Rays, pair: StereoPair) -> SecondView:
    """The rays from the second imager to each hit of the camera's rays."""
    device = rays.directions.device
    towards = wp.empty(hits.distance.size, dtype=wp.vec3d, device=device)
    length = wp.empty(hits.distance.size, dtype=float, device=device)
    inputs = [pair.baseline, lines_of(rays.directions, hits.distance), lines_of(towards, length)]
    launch_over_rays(look_from_second, towards.size, inputs, [], device)
    origin = wp.full(1, wp.vec3d(pair.baseline, 0.0, 0.0), dtype=wp.vec3d, device=device)
    return SecondView(steered(rays, towards, origin), length)


def hide(hits: HitArrays, view: SecondView, met: HitArrays, pair: StereoPair) -> None:
    """Set the distance of hits that the second imager does not see to NaN, in place. met: hits of the view's rays."""
    inputs = [pair, lines_of(view.rays.directions, view.length), met.out()]
    launch_over_rays(hide_unseen, hits.distance.size, inputs, [hits.out()], hits.distance.device)


@wp.kernel
def fatten_edges(first: int, pair: StereoPair, half: int, surface: Out, matched: Lines, out: Out) -> None:
    """Give each pixel the depth, shape and normal of the nearest surface in its window that is an edge.

    A pixel of the window is an edge if its disparity exceeds that of the plane of the pixel's own surface by EDGE. On
    the plane n . p = c the inverse depth along a ray (x, y, 1) is n . (x, y, 1) / c, so a slanted surface is no edge.
    Without an edge a pixel keeps its own surface.

    surface: the hits. matched: distance [m] of each pixel, NaN where it is not matched. half: of the window [pixels].
    """
    i = first + wp.tid()
    ray = of_ray(matched.directions, i)
    n = surface.normal[i]
    c = float(wp.dot(to_double(n), ray)) * surface.distance[i]
    nearest = i
    inverse = float(0.0)
    pixel = i % (pair.width * pair.height)
    row = pixel / pair.width
    column = pixel % pair.width
    for v in range(wp.max(row - half, 0), wp.min(row + half + 1, pair.height)):
        for u in range(wp.max(column - half, 0), wp.min(column + half + 1, pair.width)):
            j = i - pixel + v * pair.width + u
            other = to_float(of_ray(matched.directions, j))
            z = matched.distance[j] * other[2]
            if wp.isfinite(z) and z > 0.0 and 1.0 / z > inverse:
                plane = float(0.0)
                if surface.shape[i] >= 0 and c != 0.0:
                    plane = wp.max(wp.dot(n, other) / (c * other[2]), 0.0)
                if pair.focal * wp.abs(pair.baseline) * (1.0 / z - plane) > EDGE:
                    nearest = j
                    inverse = 1.0 / z
    out.distance[i] = matched.distance[i]
    if nearest != i:
        out.distance[i] = 1.0 / (inverse * float(ray[2]))
    out.shape[i] = surface.shape[nearest]
    out.normal[i] = surface.normal[nearest]


def fatten(
    surface: HitArrays, matched: wp.array, directions: wp.array, pair: StereoPair, window: int, out: HitArrays
) -> None:
    """Write hits after matching windows of `window` pixels, an odd number; see fatten_edges. `face` is not written.

    matched: (n,) float32 [m], the distance of each pixel of `surface`; NaN where it is not matched.
    """
    inputs = [pair, window // 2, surface.out(), lines_of(directions, matched)]
    launch_over_rays(fatten_edges, matched.size, inputs, [out.out()], matched.device)


@wp.func
def disturb(i: int, chance: float, pair: StereoPair, std: float, step: float, greatest: float, seen: Lines) -> None:
    """Add the error of the measured disparity to distance i.

    d' = d + std * chance, rounded to multiples of `step` if that is > 0 [pixels]. The distance becomes +inf if d' <= 0,
    -inf if d' > greatest, NaN if the depth is not positive. One that is not finite stays.
    """
    along = float(of_ray(seen.directions, i)[2])
    z = seen.distance[i] * along
    if not wp.isfinite(seen.distance[i]):
        return
    if z <= 0.0:
        seen.distance[i] = wp.nan
        return
    disparity = depth_of_disparity(pair, z)
    disparity += std * chance
    if step > 0.0:
        disparity = step * wp.round(disparity / step)
    seen.distance[i] = depth_of_disparity(pair, disparity) / along
    if disparity <= 0.0:
        seen.distance[i] = wp.inf
    elif disparity > greatest:
        seen.distance[i] = -wp.inf


@wp.kernel
def disturb_disparity(
    first: int,
    run: int,  # rays per thread
    pair: StereoPair,
    std: float,
    step: float,
    greatest: float,
    draws: Draws,
    seen: Lines,  # distance in and out
) -> None:
    """Add the error of the measured disparity to all distances; see `disturb`."""
    i = (first + wp.tid()) * run
    end = wp.min(i + run, seen.distance.shape[0])
    while i < end:
        disturb(i, draws.numbers[i][0], pair, std, step, greatest, seen)
        i += 1


def measure_disparity(
    hits: HitArrays,
    directions: wp.array,
    pair: StereoPair,
    source: RandomSource,
    *,
    std: float,
    step: float,
    greatest: float,
) -> None:
    """Add the error of the measured disparity to distances [m], in place.

    Distances become +inf for a measured disparity <= 0, -inf for one above `greatest`, NaN for a depth <= 0; those not
    finite stay.

    Args:
        std: standard deviation of the disparity [pixels].
        step: the disparity is rounded to multiples of it [pixels]; 0 for none.
        greatest: the largest disparity that is found [pixels].
    """
    count, device = hits.distance.size, directions.device
    inputs = [pair, std, step, greatest, drawn(source, DRAW_DISPARITY, count, device)]
    launch_over_runs(disturb_disparity, count, inputs, [lines_of(directions, hits.distance)], device)
