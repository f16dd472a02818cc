"""Readings of a lidar with effects: beams, echoes, weather, returns, ranging."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import is_
from typing import Any

import numpy as np
import warp as wp

from rigcast.kernels.cast import Readings, launch
from rigcast.kernels.effects.draws import BYTES_PER_DRAW
from rigcast.kernels.effects.lidars import beams, echoes, ranging, returns, weather
from rigcast.kernels.effects.light import SPEED_OF_LIGHT
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import BYTES_PER_HIT, HitArrays
from rigcast.kernels.hits.out import Out
from rigcast.kernels.hits.reading import prepare_read
from rigcast.kernels.launching.recorded import turn_struct
from rigcast.kernels.packing.steered import steered
from rigcast.kernels.rays.arrays import BYTES_PER_DIRECTION, RayArrays, Rays
from rigcast.sensors.captured import is_captured
from rigcast.sensors.scene.looks import Looks
from rigcast.sensors.scene.stage import Stage
from rigcast.sensors.specs.lidars.effects import Noise, Weather
from rigcast.sensors.specs.lidars.lidar import Lidar

from .physics import Reading
from .sub_rays import SubRays

_MODES = {
    "first": returns.FIRST,
    "last": returns.LAST,
    "strongest": returns.STRONGEST,
    "dual": returns.DUAL,
}
_ENDED = wp.vec3d(wp.nan, wp.nan, wp.nan)
"""The direction of light that has ended."""
_LISA_DIVERGENCE = 3e-3  # [rad], where the lidar's own is not given


class LidarPhysics:
    """The effects in the specification of a lidar of `count` rays, prepared on a scene's device."""

    def __init__(self, scene: Stage, spec: Lidar, count: int) -> None:
        self._scene, self._spec, self._count = scene, spec, count
        noise = spec.noise or Noise()
        angles, weights = _sub_rays(spec)
        self._sub_rays = len(weights)
        # a function that held self would make a reference cycle, in which arrays wait for the collector
        self._angles = sub_angles = wp.array(angles, dtype=wp.vec2, device=scene.device)
        self._angle_std = math.radians(noise.angle_std_deg)
        self._spread = SubRays(self._sub_rays, lambda rays: beams.aim(rays, sub_angles, RandomSource(), 0.0))
        self._travelled = wp.zeros(self._count * self._sub_rays, dtype=float, device=scene.device)
        self._share = wp.array(np.tile(weights, self._count), dtype=float, device=scene.device)
        self._extinction = _extinction(spec.weather or Weather())
        self._rain = weather.rain_of(spec.weather.rain_rate if spec.weather else 0.0, _divergence(spec))
        self._fog = weather.fog_of(_fog_response(spec, self._extinction), scene.device)
        self._noise = _range_noise(spec)
        self._steps: _Steps | None = None

    @property
    def bytes_per_ray(self) -> int:
        """Upper bound on the memory [bytes] of a reading per ray: hits, sub-rays, paths, echoes, random numbers."""
        spec, returns_kept = self._spec, self._spec.returns_per_ray
        ways = self._sub_rays * (1 + (spec.max_surfaces > 1) + spec.mirrors)
        slots = self._sub_rays * (spec.max_surfaces + spec.mirrors) + 2 * (spec.weather is not None)
        aimed = self._sub_rays * BYTES_PER_DIRECTION if self._angle_std > 0 else 0
        return (
            aimed
            + self._sub_rays * BYTES_PER_HIT
            + ways * echoes.BYTES_PER_PATH
            + (slots + returns_kept) * echoes.BYTES_PER_ECHO
            + returns_kept * BYTES_PER_DRAW
        )

    @property
    def kept_bytes_per_ray(self) -> int:
        """Memory [bytes] per ray that is kept with the frame: the intensity of its returns."""
        return 4 * self._spec.returns_per_ray

    def read(self, rays: Rays, visible: wp.array, source: RandomSource, out: HitArrays) -> Reading:
        """One reading of the scene with the sensor's rays at its current pose."""
        device, steps = self._scene.device, self._steps_for(rays.worlds)
        sub_rays = rays if self._sub_rays == 1 else self._spread.of(rays)
        if self._angle_std > 0:
            sub_rays = steered(sub_rays, beams.aim(rays, self._angles, source, self._angle_std, rays.worlds))
        power = wp.empty(out.distance.size, dtype=float, device=device)
        steps.turn_to(rays, sub_rays, source, out, power)
        return Reading(partial(_copied, power), (steps, steps.read(sub_rays, visible)))

    def _steps_for(self, worlds: int) -> "_Steps":
        """The steps of a reading of this many worlds; those of the last reading, if they are."""
        looks = self._scene.looks()
        if self._steps is not None and self._steps.worlds == worlds and self._steps.looks is looks:
            return self._steps
        if is_captured(self._scene.device):  # their memory belongs to the graph
            return self._prepare(looks, worlds)
        self._steps = None  # its memory can be taken again
        self._steps = self._prepare(looks, worlds)
        return self._steps

    def _prepare(self, looks: Looks, worlds: int) -> "_Steps":
        """Prepare all echoes: of successive surfaces, of what a mirror shows, of rain and fog; and their returns."""
        spec, device, beams_cast = self._spec, self._scene.device, self._count * worlds
        count = beams_cast * self._sub_rays
        layers = spec.max_surfaces if looks.has_transparent else 1
        shows_mirrors = spec.mirrors and looks.has_mirrors
        slots = self._sub_rays * (layers + shows_mirrors)
        found = echoes.new_echoes(slots + 2 * (spec.weather is not None), beams_cast, device)
        steps = _Steps(self._scene, spec.max_range, looks, worlds, HitArrays.empty(count, device))
        setting, nowhere = self._setting(looks), echoes.Paths()
        aside = echoes.new_paths(count, device) if shows_mirrors else nowhere
        paths = echoes.Paths()
        paths.travelled, paths.share = self._travelled, self._share
        for layer in range(layers):
            beyond = echoes.new_paths(count, device) if layer + 1 < layers else nowhere
            steps.follow(setting, paths, layer * self._sub_rays, found, beyond, aside)
            paths = beyond
        if shows_mirrors:
            steps.aside = aside
            steps.follow(setting, aside, layers * self._sub_rays, found, nowhere, nowhere)
        if spec.weather is not None:
            around = self._rain, self._fog, steps.source, self._extinction
            steps.then.append(weather.prepare_weather(*around, found, beams_cast, slots))
        least_power = spec.detection.least_power if spec.detection else 0.0
        gap = 0.5 * SPEED_OF_LIGHT * spec.pulse_length
        steps.then.append(
            returns.prepare_choice(found, beams_cast, gap, least_power, _MODES[spec.returns], steps.returns)
        )
        per_beam, limits = spec.returns_per_ray, (spec.min_range, spec.max_range)
        steps.then.append(
            ranging.Measurement(steps.returns, beams_cast, per_beam, self._noise, steps.source, limits, device)
        )
        steps.out.min_range = spec.min_range
        steps.then.append(prepare_read(steps.rays, per_beam, beams_cast * per_beam, steps.out, device))
        return steps

    def _setting(self, looks: Looks) -> echoes.Setting:
        """The setting of a reading. Surfaces are opaque and no mirrors unless the specification enables these."""
        surfaces, none = echoes.SurfaceArrays(), wp.zeros_like(looks.reflectivity)
        surfaces.reflectivity = looks.reflectivity
        surfaces.transmission = looks.surfaces.transmission if self._spec.max_surfaces > 1 else none
        surfaces.mirror = looks.surfaces.mirror if self._spec.mirrors else none
        lobe = math.radians(self._spec.mirror_lobe_deg)
        return echoes.Setting(surfaces, self._spec.max_range, self._extinction, lobe, self._sub_rays)


class _Steps:
    """The launches of a reading of some number of worlds with these looks, prepared once, and the arrays between them.

    hits: of each cast in turn. aside: paths of light from mirrors. then: launches after all casts. source, rays,
    returns, out: what `turn_to` changes.
    """

    def __init__(self, scene: Stage, limit: float, looks: Looks, worlds: int, hits: HitArrays) -> None:
        self.looks, self.worlds = looks, worlds
        self.aside: echoes.Paths | None = None
        self.then: list[Callable[[], object]] = []
        self.source, self.rays = RandomSource(), RayArrays()
        self.returns: Any = echoes.Echoes()
        self.out: Any = Out()
        self._scene, self._limit, self._hits = scene, limit, hits
        self._paths: list[echoes.Paths] = []
        self._reflections: list[echoes.Reflections] = []
        # the casts along all paths, and what they were prepared for:
        self._casts: tuple[list[Readings], tuple[object, ...]] = ([], ())

    def follow(
        self,
        setting: echoes.Setting,
        paths: echoes.Paths,
        first_slot: int,
        found: echoes.Echoes,
        beyond: echoes.Paths,
        aside: echoes.Paths,
    ) -> None:
        """Add a cast along these paths and the reflections of what it hits."""
        self._paths.append(paths)
        self._reflections.append(echoes.Reflections(setting, self._hits, paths, first_slot, found, beyond, aside))

    def turn_to(self, rays: Rays, sub_rays: Rays, source: RandomSource, out: HitArrays, power: wp.array) -> None:
        """Take these rays and random numbers, and arrays for the returns; the caller must keep all of them alive."""
        turn_struct(self.rays, rays.arrays)
        turn_struct(self.source, source)
        for reflections in self._reflections:
            reflections.turn_to(sub_rays)
        kept = self.returns.__ctype__()
        out.lend(kept)
        kept.power = power.__ctype__()
        out.lend(self.out.__ctype__())

    def read(self, rays: Rays, visible: wp.array) -> object:
        """Make all launches; rays: the sub-rays. Returns what a CUDA graph that repeats them must hold."""
        used = []
        if self.aside is not None:
            self.aside.direction.fill_(_ENDED)
        for cast, reflections in zip(self._prepared_casts(rays, visible), self._reflections, strict=True):
            cast.aim(rays)
            used.append(launch([cast]))
            reflections()
        for step in self.then:
            step()
        return used

    def _prepared_casts(self, rays: Rays, visible: wp.array) -> list[Readings]:
        """The casts along all paths; prepared again unless they differ from the last in the rays' poses alone."""
        these = visible, rays.directions, rays.origins, rays.packets, rays.firing, rays.span, rays.fraction
        casts, known = self._casts
        if not casts or not all(map(is_, these, known)):
            along = [rays, *(_along(paths, rays) for paths in self._paths[1:])]
            casts = [self._scene.prepare_hits(each, visible, self._limit, self._hits) for each in along]
            self._casts = casts, these
        return casts


def _copied(values: wp.array, out: wp.array | None) -> wp.array:
    if out is None:
        return values.flatten()
    wp.copy(out, values.flatten())
    return out


def _along(paths: echoes.Paths, rays: Rays) -> Rays:
    """The paths as rays, in the frame of these rays."""
    each = (rays.worlds, -1)
    return replace(rays, directions=paths.direction.reshape(each), origins=paths.origin.reshape(each), packets=None)


def _sub_rays(spec: Lidar) -> tuple[np.ndarray, np.ndarray]:
    if spec.beam is None:
        return np.zeros((1, 2), np.float32), np.ones(1, np.float32)
    across, up = np.deg2rad(spec.beam.divergence_deg)
    return beams.hexagonal_rings(spec.beam.rings, (across, up))


def _divergence(spec: Lidar) -> float:
    """Divergence [rad] of a round beam with the same cross-section."""
    if spec.beam is None:
        return _LISA_DIVERGENCE
    return float(np.sqrt(np.prod(np.deg2rad(spec.beam.divergence_deg))))


def _extinction(around: Weather) -> float:
    """Extinction of the air [1/m]."""
    rain, fog = around.rain_rate, weather.fog_extinction(around.visibility)
    if around.rain_extinction is None or rain == 0:
        return weather.rain_extinction(rain) + fog
    factor, exponent = around.rain_extinction
    return float(factor * rain**exponent + fog)


def _fog_response(spec: Lidar, extinction: float) -> weather.FogResponse | None:
    if spec.weather is None or math.isinf(spec.weather.visibility):
        return None
    return weather.fog_response(spec.weather.visibility, extinction)


def _range_noise(spec: Lidar) -> ranging.RangeNoise:
    given, around = spec.noise or Noise(), spec.weather or Weather()
    noise = ranging.RangeNoise()
    noise.range_std, noise.resolution = given.range_std, given.range_resolution
    noise.dropout, noise.dark_dropout, noise.dark_limit = given.dropout, given.dark_dropout, given.dark_limit
    noise.power_std = spec.detection.power_std if spec.detection else 0.0
    noise.rain_std = around.rain_range_noise * (1 - math.exp(-around.rain_rate)) ** 2
    return noise
