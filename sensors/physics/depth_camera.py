"""Readings of a depth camera: the hits of its rays, its principle of measurement, and its errors."""

import math
from dataclasses import dataclass
from functools import partial

import warp as wp

from rigcast.kernels.effects.cameras import kinect_v1, stereo, time_of_flight
from rigcast.kernels.effects.cameras.losses import Losses, lose
from rigcast.kernels.effects.draws import BYTES_PER_DRAW
from rigcast.kernels.effects.light import SPEED_OF_LIGHT, infrared
from rigcast.kernels.effects.random import RandomSource
from rigcast.kernels.hits.arrays import BYTES_PER_HIT, HIT_NAMES, HitArrays
from rigcast.kernels.hits.reading import bound, read
from rigcast.kernels.packing.steered import steered
from rigcast.kernels.rays.arrays import BYTES_PER_DIRECTION, Rays
from rigcast.sensors.scene.rays.given import upload
from rigcast.sensors.scene.stage import Stage
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.cameras.ranging import Ranging, Stereo, TimeOfFlight
from rigcast.sensors.specs.pattern import Pattern

from .physics import Reading
from .sub_rays import SubRays

_KINECT_V1 = {"nguyen": kinect_v1.NGUYEN, "disparity": kinect_v1.DISPARITY}


@dataclass(frozen=True, eq=False)
class _Look:
    """One look of a camera through its rays."""

    scene: Stage
    rays: Rays
    visible: wp.array
    source: RandomSource

    def cast(self, rays: Rays) -> HitArrays:
        """Hits of rays from the camera at any distance, with normals in its frame."""
        hits = self.scene.cast_rays(rays, self.visible, math.inf)
        read(hits, rays, min_range=0.0)
        return hits

    def lose(self, spec: Ranging, untextured_dropout: float, hits: HitArrays) -> None:
        """Set the distance of lost pixels to NaN, if the specification has losses."""
        losses = Losses()
        losses.dropout, losses.untextured_dropout = spec.dropout, untextured_dropout
        losses.min_cosine = math.cos(math.radians(spec.max_incidence_deg)) if spec.max_incidence_deg < 90 else 0.0
        losses.min_intensity = spec.min_intensity
        if losses.dropout or losses.untextured_dropout or losses.min_cosine or losses.min_intensity:
            looks = self.scene.looks()
            lose(hits, losses, self.source, self.rays.directions, looks.reflectivity, looks.textured)


class DepthPhysics:
    """The errors in one camera's specification, prepared on a scene's device."""

    def __init__(self, scene: Stage, spec: DepthCamera, pattern: Pattern) -> None:
        self._scene, self._spec = scene, spec
        self._read = _ReadStereo(spec.stereo, pattern) if spec.stereo else _ReadTimeOfFlight(scene, spec, pattern)

    @property
    def bytes_per_ray(self) -> int:
        """Upper bound on the memory [bytes] of a reading per ray: the hits and directions of every cast, and
        random numbers."""
        flight = self._spec.time_of_flight
        casts = 4 if flight is None else 2 + flight.subrays**2
        return casts * (BYTES_PER_HIT + BYTES_PER_DIRECTION) + BYTES_PER_DRAW

    @property
    def kept_bytes_per_ray(self) -> int:
        """Memory [bytes] per ray that is kept with the frame: the true hits, for its infrared intensity."""
        return BYTES_PER_HIT

    def read(self, rays: Rays, visible: wp.array, source: RandomSource, out: HitArrays) -> Reading:
        """One reading of the scene with rays through the pixels' centres. Its intensity is that of the true hits."""
        seen = self._read(_Look(self._scene, rays, visible, source), out)
        bound(out, self._spec.min_range, self._spec.max_range)
        reflectivity = self._scene.looks().reflectivity
        return Reading(partial(infrared, seen, rays.directions, reflectivity), used=None)


class _ReadStereo:
    def __init__(self, spec: Stereo, pattern: Pattern) -> None:
        assert pattern.intrinsics is not None
        self._spec, self._pair = spec, stereo.StereoPair()
        self._pair.height, self._pair.width = pattern.shape
        self._pair.focal, self._pair.centre = pattern.intrinsics[0, 0], pattern.intrinsics[0, 2]
        self._pair.baseline = spec.baseline

    def __call__(self, look: _Look, out: HitArrays) -> HitArrays:
        """Write what is measured; return the true hits, at any distance. Both have normals in the camera's frame."""
        spec, directions = self._spec, look.rays.directions
        seen = look.cast(look.rays)
        surface = seen if spec.kinect_v1 is None else self._shifted(look, seen)
        _copy(surface, out)
        if spec.shadow:
            view = stereo.second_view(surface, look.rays, self._pair)
            stereo.hide(out, view, look.scene.cast_rays(view.rays, look.visible, math.inf), self._pair)
        if spec.matching_window > 1:
            stereo.fatten(surface, wp.clone(out.distance), directions, self._pair, spec.matching_window, out)
        look.lose(spec, spec.untextured_dropout, out)
        self._disturb(look, out)
        return seen

    def _shifted(self, look: _Look, seen: HitArrays) -> HitArrays:
        """Hits along rays with the Kinect's lateral error, converted to the pixels' own rays at the same depth."""
        assert self._spec.kinect_v1 is not None
        model, size = _KINECT_V1[self._spec.kinect_v1], (self._pair.width, self._pair.height)
        shifted = kinect_v1.shift(model, size, look.source, look.rays.directions, seen.normal)
        hits = look.cast(steered(look.rays, shifted))
        kinect_v1.at_own_pixel(hits.distance, shifted, look.rays.directions)
        return hits

    def _disturb(self, look: _Look, hits: HitArrays) -> None:
        """Add the errors of depth and disparity."""
        spec, directions = self._spec, look.rays.directions
        if spec.kinect_v1 is not None:
            model = _KINECT_V1[spec.kinect_v1]
            kinect_v1.measure_depth(model, look.source, directions, hits.normal, hits.distance)
        if spec.disparity_std > 0 or spec.disparity_step > 0 or math.isfinite(spec.max_disparity):
            std, step, greatest = spec.disparity_std, spec.disparity_step, spec.max_disparity
            stereo.measure_disparity(hits, directions, self._pair, look.source, std=std, step=step, greatest=greatest)


class _ReadTimeOfFlight:
    def __init__(self, scene: Stage, spec: DepthCamera, pattern: Pattern) -> None:
        assert spec.time_of_flight is not None
        self._spec: TimeOfFlight = spec.time_of_flight
        self._subrays = None
        if pattern.subrays is not None:
            directions = upload(pattern.subrays, scene.device)
            self._subrays = SubRays(spec.time_of_flight.subrays**2, lambda _: directions)

    def __call__(self, look: _Look, out: HitArrays) -> HitArrays:
        """As _ReadStereo."""
        spec = self._spec
        if self._subrays is None:
            seen = look.cast(look.rays)
        else:
            rays = self._subrays.of(look.rays)
            seen = time_of_flight.mix(
                look.cast(rays), rays.directions, look.scene.looks().reflectivity, spec.subrays**2
            )
        _copy(seen, out)
        look.lose(spec, 0.0, out)
        wrap = math.inf if spec.modulation_hz is None else SPEED_OF_LIGHT / (2 * spec.modulation_hz)
        std, bias, per_metre = spec.range_std, spec.bias, spec.bias_per_metre
        time_of_flight.measure_range(out, look.source, std=std, bias=bias, bias_per_metre=per_metre, wrap=wrap)
        return seen


def _copy(hits: HitArrays, out: HitArrays) -> None:
    for name in HIT_NAMES:
        wp.copy(getattr(out, name), getattr(hits, name))
