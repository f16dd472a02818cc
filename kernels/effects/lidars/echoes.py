"""Echoes of a lidar's light from the surfaces that it meets.

The received power from a Lambertian surface of reflectivity rho, relative to that of a white surface facing the sensor
at 1 m, is after Kilic et al., "Lidar light scattering augmentation (LISA)", 2021, arXiv 2107.07004:

    P = rho cos(theta) exp(-2 a R) / R^2

with theta the angle of incidence, R the range [m] and a the extinction of the air [1/m]. A surface transmits the share
T of the light and reflects the share s of the rest as a mirror. Its echo is then

    P = (1 - T) ((1 - s) rho cos(theta) + s [theta <= lobe]) exp(-2 a R) / R^2

Echoes from behind it keep T^2 of their power, for the ways out and back. Beyond the lobe a mirror sends light aside;
echoes of what that light meets keep ((1 - T) s)^2 of their power, and the receiver locates them straight ahead.
"""

import math
from dataclasses import dataclass

import warp as wp

from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.launching.slices import prepare_over_runs
from rigcast.kernels.rays.arrays import RayArrays, Rays, firing_of
from rigcast.kernels.vectors import modulo, of_ray, to_double

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NEAREST = wp.constant(1.0e-3)  # [m], nearer echoes have the power of this range
BYTES_PER_PATH = 56  # of Paths
BYTES_PER_ECHO = 28  # of Echoes
SHALLOWEST = wp.constant(0.05)  # least cosine by which the step off a surface is divided


@wp.struct
class SurfaceArrays:
    """Optics of each shape, (shapes,): diffuse reflectivity rho, transmission T, mirror share s of the rest."""

    reflectivity: wp.array[float]
    transmission: wp.array[float]
    mirror: wp.array[float]


@wp.struct
class Echoes:
    """Echoes, or returns, of a number of beams, in arrays (slots * beams,).

    An echo of beam i in slot q is entry q * beams + i. The l-th surface that sub-ray s meets, of S sub-rays per beam,
    has slot q = l * S + s. What a mirror shows counts as one more surface; rain and fog take the last two slots. The
    returns of `returns.choose` are ordered by beam instead: return k of beam i is entry i * per_beam + k.
    """

    distance: wp.array[float]  # range along the beam [m]; +inf for no echo, NaN for a beam that is not finite
    power: wp.array[float]  # P as above; 0 for no echo
    # of the surface that is hit; not defined where there is no echo:
    shape: wp.array[int]
    face: wp.array[int]
    normal: wp.array[wp.vec3]  # unit, in the world


@wp.struct
class Paths:
    """Paths of light in the rays' frame, one per sub-ray. A direction of NaN marks light that has ended.

    origin: [m]. travelled: length of the path from the sensor to the origin [m]. share: of the power that is left, 0 to
    1. Each array has one entry per path, or per path of one world for all worlds; origin may also have just one.
    """

    direction: wp.array[wp.vec3d]
    origin: wp.array[wp.vec3d]
    travelled: wp.array[float]
    share: wp.array[float]


@dataclass(frozen=True)
class Setting:
    """The conditions of one reading.

    limit: range of the farthest echo [m]. extinction: of the air [1/m]. lobe: half angle within which a mirror reflects
    light back to the receiver [rad]. sub_rays: number per beam.
    """

    surfaces: SurfaceArrays
    limit: float
    extinction: float
    lobe: float
    sub_rays: int


@wp.func
def stopped() -> wp.vec3d:
    """The direction, NaN, of light that has ended."""
    return wp.vec3d(wp.float64(wp.nan))


@wp.func
def spread_power(share: float, distance: float, extinction: float) -> float:
    """The power share exp(-2 a R) / R^2, with R at least NEAREST in the denominator."""
    nearest = wp.max(distance, NEAREST)
    if extinction > 0.0:
        share *= wp.exp(-2.0 * extinction * distance)
    return share / (nearest * nearest)


@wp.func
def diffuse_share(surfaces: SurfaceArrays, shape: int, cosine: float) -> float:
    """The share (1 - T) (1 - s) rho cos(theta) of diffuse reflection."""
    opaque = 1.0 - surfaces.transmission[shape]
    return opaque * (1.0 - surfaces.mirror[shape]) * surfaces.reflectivity[shape] * cosine


@wp.func
def go_on(paths: Paths, j: int, direction: wp.vec3d, distance: float, share: float, out: Paths) -> None:
    """Continue path j in `out` from a point at this distance [m] on it.

    share: of the light that passes that point on the way out, and again on the way back.
    """
    out.direction[j] = direction
    out.origin[j] = of_ray(paths.origin, j) + wp.float64(distance) * of_ray(paths.direction, j)
    out.travelled[j] = paths.travelled[modulo(j, paths.travelled.shape[0])] + distance
    out.share[j] = paths.share[modulo(j, paths.share.shape[0])] * share * share


@wp.struct
class Meeting:
    """Setting as a struct for kernels, with the paths, their hits, and the first slot of their echoes.

    hits: of the paths, entry j for path j; normals in the world.
    """

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
    """Index in Echoes' arrays of the echo of path j, the path of sub-ray j % sub_rays of beam j / sub_rays."""
    paths = meeting.hits.distance.shape[0]
    if meeting.sub_rays == 1:
        return meeting.first_slot * paths + j
    return (meeting.first_slot + j % meeting.sub_rays) * (paths / meeting.sub_rays) + j / meeting.sub_rays


@wp.func
def reflect_path(meeting: Meeting, j: int, echoes: Echoes, beyond: Paths, aside: Paths) -> None:
    """Write the echo of path j's hit, and the paths of the light that goes on from there.

    The echo has the range of the whole path, path.travelled + hit distance [m], and the power of this module's
    equation times the path's share. Without a hit, or beyond the limit, its distance is +inf and its power 0; at the
    first surface (first_slot = 0) a miss keeps its distance, so that NaN marks a beam that is not finite. shape, face
    and normal are written only for an echo.

    beyond: path j goes on behind the surface if that transmits light, else its direction becomes NaN. aside: path j
    goes on in the mirrored direction, for the first mirror on the way that the light meets outside the lobe. Both begin
    a step of 1e-5 (1 + distance) / max(cos(theta), SHALLOWEST) off the surface, so as not to hit it again, and both may
    be empty.
    """
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
    travelled = paths.travelled[modulo(j, paths.travelled.shape[0])] + distance
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
    share = paths.share[modulo(j, paths.share.shape[0])]
    echoes.distance[slot] = travelled
    echoes.power[slot] = spread_power(share * reflected, travelled, meeting.extinction)
    echoes.shape[slot] = hit
    echoes.face[slot] = hits.face[j]
    echoes.normal[slot] = hits.normal[j]
    let_through = surfaces.transmission[hit]
    step = 1.0e-5 * (1.0 + distance) / wp.max(cosine, SHALLOWEST)
    if beyond.direction.shape[0] > 0 and let_through > 0.0:
        go_on(paths, j, direction, distance + step, let_through, beyond)
    is_seen_aside = aside.direction.shape[0] > 0 and mirrored > 0.0 and cosine < meeting.lobe_cosine
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
    """Write the echoes and continued paths of all paths; see `reflect_path`."""
    j = (first + wp.tid()) * run
    end = wp.min(j + run, meeting.hits.distance.shape[0])
    while j < end:
        reflect_path(meeting, j, echoes, beyond, aside)
        j += 1


def new_echoes(slots: int, beams: int, device: wp.DeviceLike) -> Echoes:
    """Uninitialised arrays for echoes in `slots` slots of each beam."""
    count = slots * beams
    echoes = Echoes()
    echoes.distance = wp.empty(count, dtype=float, device=device)
    echoes.power = wp.empty(count, dtype=float, device=device)
    echoes.shape = wp.empty(count, dtype=int, device=device)
    echoes.face = wp.empty(count, dtype=int, device=device)
    echoes.normal = wp.empty(count, dtype=wp.vec3, device=device)
    return echoes


def new_paths(count: int, device: wp.DeviceLike) -> Paths:
    """Uninitialised arrays for light that goes on."""
    paths = Paths()
    paths.direction, paths.origin = (wp.empty(count, dtype=wp.vec3d, device=device) for _ in range(2))
    paths.travelled, paths.share = (wp.empty(count, dtype=float, device=device) for _ in range(2))
    return paths


class Reflections:
    """A repeatable launch that writes the echo of each path's hit, and the light that goes on; `turn_to` rays first.

    Args:
        hits: of the paths, with normals in the world.
        paths: of the light. Those in slot 0 begin at the sensor and follow the rays; only their `travelled` and `share`
            are given.
        first_slot: echoes go to slots first_slot, ... first_slot + sub_rays - 1.
        beyond: out, paths of light transmitted by the surfaces; empty to drop it.
        aside: in and out, paths of light that the first mirror on the way sends aside, all marked as ended before the
            first launch; empty to drop it.
    """

    def __init__(
        self,
        setting: Setting,
        hits: HitArrays,
        paths: Paths,
        first_slot: int,
        echoes: Echoes,
        beyond: Paths,
        aside: Paths,
    ) -> None:
        meeting = Meeting()
        meeting.surfaces, meeting.hits, meeting.paths = setting.surfaces, hits.out(), paths
        meeting.sub_rays, meeting.first_slot = setting.sub_rays, first_slot
        meeting.limit, meeting.extinction = setting.limit, setting.extinction
        meeting.lobe_cosine = math.cos(setting.lobe)
        self._meeting, self._at_sensor = meeting, first_slot == 0
        count, device = hits.distance.size, hits.distance.device
        self._launch = prepare_over_runs(reflect_paths, count, [meeting], [echoes, beyond, aside], device)

    def turn_to(self, rays: Rays) -> None:
        """Take the rays along which the light leaves the sensor; the caller must keep them alive."""
        meeting = self._meeting.__ctype__()
        meeting.rays = rays.arrays.__ctype__()
        if self._at_sensor:
            meeting.paths.direction, meeting.paths.origin = meeting.rays.directions, meeting.rays.origins

    def __call__(self) -> None:
        self._launch()
