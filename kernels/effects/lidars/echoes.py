"""What comes back of a lidar's light from the surfaces that it meets.

The received power of a surface that reflects the share rho of the light in all directions (Lambert), relative to that
of a white one facing the sensor at 1 m, after Kilic et al., "Lidar light scattering augmentation (LISA)", 2021,
arXiv 2107.07004:

    P = rho cos(theta) exp(-2 a R) / R^2

with theta the angle of incidence, R the range and a the extinction of the air. A surface lets the share T of the light
through and reflects s of the rest as a mirror. Its echo is then

    P = (1 - T) ((1 - s) rho cos(theta) + s [theta <= lobe]) exp(-2 a R) / R^2

and T^2 of the power is left of what lies behind it, on the way out and back. What a mirror shows beyond that lobe has
((1 - T) s)^2 of the power, and is found by the receiver where its light seems to come from: straight on.

Echoes stand in slots: that of sub-ray s at the l-th surface of beam i, of n with S sub-rays each, is (l S + s) n + i.
"""

import math
from dataclasses import dataclass

import warp as wp

from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import launch_over_runs
from rigcast.kernels.rays.arrays import RayArrays, Rays, firing_of
from rigcast.kernels.vectors import of_ray, to_double, within

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NEAREST = wp.constant(1.0e-3)  # [m], nearer echoes have the power of this range
BYTES_PER_PATH = 56  # of Paths
BYTES_PER_ECHO = 28  # of Echoes
SHALLOWEST = wp.constant(0.05)  # least cosine by which the way past a surface is lengthened


@wp.struct
class SurfaceArrays:
    """How each shape reflects: diffuse reflectivity, share let through, mirror share of the rest."""

    reflectivity: wp.array[float]
    transmission: wp.array[float]
    mirror: wp.array[float]


@wp.struct
class Echoes:
    """Echoes in slots. distance +inf where there is none, NaN where the beam itself is not finite."""

    distance: wp.array[float]
    power: wp.array[float]
    shape: wp.array[int]
    face: wp.array[int]
    normal: wp.array[wp.vec3]


@wp.struct
class Paths:
    """Light on its way, one per sub-ray, in the rays' frame. A direction of NaN is light that does not go on.

    travelled: from the sensor to the origin [m]. share: of the power that is left. Any of these may be the same in all
    worlds, as light leaves the sensor, and origin the same for all.
    """

    direction: wp.array[wp.vec3d]
    origin: wp.array[wp.vec3d]
    travelled: wp.array[float]
    share: wp.array[float]


@dataclass(frozen=True)
class Setting:
    """What the light of one reading meets.

    rays: whose light it is, before it meets anything. limit: the farthest echo [m]. extinction: of the air [1/m].
    lobe: half angle within which a mirror sends light back to the receiver [rad]. sub_rays: of each beam.
    """

    surfaces: SurfaceArrays
    rays: Rays
    limit: float
    extinction: float
    lobe: float
    sub_rays: int


@wp.func
def stopped() -> wp.vec3d:
    return wp.vec3d(wp.float64(wp.nan), wp.float64(wp.nan), wp.float64(wp.nan))


@wp.func
def spread_power(share: float, distance: float, extinction: float) -> float:
    """share exp(-2 a R) / R^2."""
    nearest = wp.max(distance, NEAREST)
    if extinction > 0.0:
        share *= wp.exp(-2.0 * extinction * distance)
    return share / (nearest * nearest)


@wp.func
def diffuse_share(surfaces: SurfaceArrays, shape: int, cosine: float) -> float:
    """(1 - T) (1 - s) rho cos(theta)."""
    opaque = 1.0 - surfaces.transmission[shape]
    return opaque * (1.0 - surfaces.mirror[shape]) * surfaces.reflectivity[shape] * cosine


@wp.func
def go_on(paths: Paths, j: int, direction: wp.vec3d, distance: float, share: float, out: Paths) -> None:
    """Light that goes on from this far along path j, a share of it each way."""
    out.direction[j] = direction
    out.origin[j] = of_ray(paths.origin, j) + wp.float64(distance) * of_ray(paths.direction, j)
    out.travelled[j] = paths.travelled[within(j, paths.travelled.shape[0])] + distance
    out.share[j] = paths.share[within(j, paths.share.shape[0])] * share * share


@wp.struct
class Meeting:
    """Surfaces, what of them is hit, and the light that meets them, as in Setting; the slots of its echoes."""

    surfaces: SurfaceArrays
    hits: Out
    paths: Paths
    rays: RayArrays
    limit: float
    extinction: float
    lobe_cosine: float
    sub_rays: int
    first_slot: int


@wp.func
def slot_of(meeting: Meeting, j: int) -> int:
    """Of the echo of path j."""
    paths = meeting.hits.distance.shape[0]
    if meeting.sub_rays == 1:
        return meeting.first_slot * paths + j
    return (meeting.first_slot + j % meeting.sub_rays) * (paths / meeting.sub_rays) + j / meeting.sub_rays


@wp.func
def reflect_path(meeting: Meeting, j: int, echoes: Echoes, beyond: Paths, aside: Paths) -> None:
    hits = meeting.hits
    paths = meeting.paths
    surfaces = meeting.surfaces
    slot = slot_of(meeting, j)
    echoes.distance[slot] = wp.inf
    echoes.power[slot] = 0.0
    if beyond.direction.shape[0] > 0:
        beyond.direction[j] = stopped()
    hit = hits.shape[j]
    if hit < 0:
        if meeting.first_slot == 0:
            echoes.distance[slot] = hits.distance[j]  # +inf, or NaN
        return
    distance = hits.distance[j]
    travelled = paths.travelled[within(j, paths.travelled.shape[0])] + distance
    if travelled > meeting.limit:
        return
    rotation = meeting.rays.rotation[firing_of(meeting.rays, j)]
    direction = of_ray(paths.direction, j)
    d = rotation * direction
    n = to_double(hits.normal[j])
    along = wp.dot(d, n)
    cosine = wp.min(float(wp.abs(along)), 1.0)
    opaque = 1.0 - surfaces.transmission[hit]
    mirrored = opaque * surfaces.mirror[hit]
    reflected = diffuse_share(surfaces, hit, cosine)
    if cosine >= meeting.lobe_cosine:
        reflected += mirrored
    share = paths.share[within(j, paths.share.shape[0])]
    echoes.distance[slot] = travelled
    echoes.power[slot] = spread_power(share * reflected, travelled, meeting.extinction)
    echoes.shape[slot] = hit
    echoes.face[slot] = hits.face[j]
    echoes.normal[slot] = hits.normal[j]
    let_through = surfaces.transmission[hit]
    # a little on, so as not to hit the same surface again
    step = 1.0e-5 * (1.0 + distance) / wp.max(cosine, SHALLOWEST)
    if beyond.direction.shape[0] > 0 and let_through > 0.0:
        go_on(paths, j, direction, distance + step, let_through, beyond)
    is_seen_aside = aside.direction.shape[0] > 0 and mirrored > 0.0 and cosine < meeting.lobe_cosine
    # one bounce: the first mirror on the way
    # nested, as older versions of Warp evaluate the whole of an `and`, and aside may be empty
    if is_seen_aside:  # noqa: SIM102
        if not wp.isfinite(aside.direction[j]):
            reflected_direction = wp.transpose(rotation) * (d - wp.float64(2.0) * along * n)
            go_on(paths, j, reflected_direction, distance - step, mirrored, aside)


@wp.kernel
def reflect_paths(
    first: int,
    run: int,  # paths per thread
    meeting: Meeting,
    # out; beyond and aside may be empty:
    echoes: Echoes,
    beyond: Paths,
    aside: Paths,
) -> None:
    j = (first + wp.tid()) * run
    end = wp.min(j + run, meeting.hits.distance.shape[0])
    while j < end:
        reflect_path(meeting, j, echoes, beyond, aside)
        j += 1


def new_echoes(slots: int, beams: int, device: wp.DeviceLike) -> Echoes:
    """Room for echoes, not yet written."""
    count = slots * beams
    echoes = Echoes()
    echoes.distance = wp.empty(count, dtype=float, device=device)
    echoes.power = wp.empty(count, dtype=float, device=device)
    echoes.shape = wp.empty(count, dtype=int, device=device)
    echoes.face = wp.empty(count, dtype=int, device=device)
    echoes.normal = wp.empty(count, dtype=wp.vec3, device=device)
    return echoes


def started(rays: Rays, travelled: wp.array, share: wp.array) -> Paths:
    """The light of rays as it leaves the sensor."""
    paths = Paths()
    paths.direction, paths.origin = rays.directions.flatten(), rays.origins.flatten()
    paths.travelled, paths.share = travelled, share
    return paths


def new_paths(count: int, device: wp.DeviceLike) -> Paths:
    """Room for light that goes on, none of which does yet; with count 0 nothing ever goes on."""
    paths = Paths()
    nan = wp.vec3d(wp.nan, wp.nan, wp.nan)
    paths.direction = wp.full(count, nan, dtype=wp.vec3d, device=device)
    paths.origin = wp.full(count, nan, dtype=wp.vec3d, device=device)
    paths.travelled, paths.share = (wp.zeros(count, dtype=float, device=device) for _ in range(2))
    return paths


def reflect(
    setting: Setting, hits: HitArrays, paths: Paths, first_slot: int, echoes: Echoes, beyond: Paths, aside: Paths
) -> None:
    """Write the echo of each path's hit to the slots from first_slot on, and the light that goes on.

    beyond: what goes through a surface. aside: what the first mirror throws elsewhere.
    """
    meeting = Meeting()
    meeting.surfaces, meeting.hits, meeting.paths = setting.surfaces, hits.out(), paths
    meeting.rays, meeting.sub_rays, meeting.first_slot = setting.rays.arrays, setting.sub_rays, first_slot
    meeting.limit, meeting.extinction, meeting.lobe_cosine = setting.limit, setting.extinction, math.cos(setting.lobe)
    launch_over_runs(reflect_paths, hits.distance.size, [meeting], [echoes, beyond, aside], hits.distance.device)
