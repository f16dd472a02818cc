"""Readings of a lidar with effects: beams, echoes, weather, returns, ranging."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import warp as wp

from rigcast.kernels.effects.draws import BYTES_PER_DRAW
from rigcast.kernels.effects.lidars import beams, echoes, ranging, returns, weather
from rigcast.kernels.effects.light import SPEED_OF_LIGHT
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import BYTES_PER_HIT, HitArrays
from rigcast.kernels.hits.reading import read
from rigcast.kernels.packing.steered import steered
from rigcast.kernels.rays.arrays import BYTES_PER_DIRECTION, Rays
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
_LISA_DIVERGENCE = 3e-3  # [rad], where the lidar's own is not given


class LidarPhysics:
    """The effects in the specification of a lidar of `count` rays, prepared on a scene's device."""

    def __init__(self, scene: Stage, spec: Lidar, count: int) -> None:
        self._scene, self._spec, self._count = scene, spec, count
        noise = spec.noise or Noise()
        angles, weights = _sub_rays(spec)
        self._sub_rays = len(weights)
        self._angles = wp.array(angles, dtype=wp.vec2, device=scene.device)
        self._angle_std = math.radians(noise.angle_std_deg)
        self._spread = SubRays(self._sub_rays, lambda rays: beams.aim(rays, self._angles, RandomSource(), 0.0))
        self._travelled = wp.zeros(self._count * self._sub_rays, dtype=float, device=scene.device)
        self._share = wp.array(np.tile(weights, self._count), dtype=float, device=scene.device)
        self._extinction = _extinction(spec.weather or Weather())
        self._rain = weather.rain_of(spec.weather.rain_rate if spec.weather else 0.0, _divergence(spec))
        self._fog = weather.fog_of(_fog_response(spec, self._extinction), scene.device)
        self._noise = _range_noise(spec)

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

    def read(self, rays: Rays, visible: wp.array, source: RandomSource) -> Reading:
        """One reading of the scene with the sensor's rays at its current pose."""
        spec, count = self._spec, self._count * rays.worlds
        sub_rays = rays if self._sub_rays == 1 else self._spread.of(rays)
        if self._angle_std > 0:
            sub_rays = steered(sub_rays, beams.aim(rays, self._angles, source, self._angle_std, rays.worlds))
        found = self._echoes(sub_rays, visible, source)
        least_power = spec.detection.least_power if spec.detection else 0.0
        gap = 0.5 * SPEED_OF_LIGHT * spec.pulse_length
        kept = returns.choose(found, count, gap, least_power, _MODES[spec.returns])
        per_beam = kept.distance.size // count
        ranging.measure(kept, per_beam, self._noise, source, (spec.min_range, spec.max_range))
        hits = HitArrays(kept.distance, kept.shape, kept.face, kept.normal)
        read(hits, rays, spec.min_range)
        return Reading(hits, partial(_copied, kept.power))

    def _echoes(self, rays: Rays, visible: wp.array, source: RandomSource) -> echoes.Echoes:
        """All echoes: of successive surfaces, of what a mirror shows, of rain and fog."""
        spec, looks, device = self._spec, self._scene.looks(), self._scene.device
        beams_cast = self._count * rays.worlds
        count = beams_cast * self._sub_rays
        layers = spec.max_surfaces if looks.has_transparent else 1
        shows_mirrors = spec.mirrors and looks.has_mirrors
        slots = self._sub_rays * (layers + shows_mirrors)
        found = echoes.new_echoes(slots + 2 * (spec.weather is not None), beams_cast, device)
        setting = self._setting(looks, rays)
        nowhere = echoes.new_paths(0, device)
        aside = echoes.new_paths(count, device) if shows_mirrors else nowhere
        paths = echoes.started(rays, self._travelled, self._share)
        for layer in range(layers):
            beyond = echoes.new_paths(count, device) if layer + 1 < layers else nowhere
            hits = self._scene.cast_rays(rays if layer == 0 else _along(paths, rays), visible, spec.max_range)
            echoes.reflect(setting, hits, paths, layer * self._sub_rays, found, beyond, aside)
            paths = beyond
        if shows_mirrors:
            hits = self._scene.cast_rays(_along(aside, rays), visible, spec.max_range)
            echoes.reflect(setting, hits, aside, layers * self._sub_rays, found, nowhere, nowhere)
        if spec.weather is not None:
            weather.add_weather(self._rain, self._fog, source, self._extinction, found, beams_cast, slots)
        return found

    def _setting(self, looks: Looks, rays: Rays) -> echoes.Setting:
        """The setting of a reading. Surfaces are opaque and no mirrors unless the specification enables these."""
        surfaces, none = echoes.SurfaceArrays(), wp.zeros_like(looks.reflectivity)
        surfaces.reflectivity = looks.reflectivity
        surfaces.transmission = looks.surfaces.transmission if self._spec.max_surfaces > 1 else none
        surfaces.mirror = looks.surfaces.mirror if self._spec.mirrors else none
        lobe = math.radians(self._spec.mirror_lobe_deg)
        return echoes.Setting(surfaces, rays, self._spec.max_range, self._extinction, lobe, self._sub_rays)


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
