"""Scanners whose beam never repeats its path, so that every reading has different rays.

Rotating wedges bend a beam by Snell's law. Let k be its unit direction times the refractive index of the medium. At a
face with unit normal n (along the light), the tangential part of k is preserved, and the length of k changes from the
index n1 before the face to n2 behind it. With c = k . n the refracted beam is

    k + (sqrt(c^2 + n2^2 - n1^2) - c) n

Background: Brazeal, Wilkinson and Hochmair, A Rigorous Observation Model for the Risley Prism-Based Livox Mid-40
Lidar Sensor, Sensors 21(14):4722, 2021.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rigcast.sensors.specs.pattern import Pattern, directions_at
from rigcast.sensors.specs.spec import Keys, Numbers, Spec, Takes, optional

if TYPE_CHECKING:  # cards of devices are drawn without Warp
    from rigcast.kernels.rays.coherent import Packets

Coordinate = float | NDArray[np.float64]
Aim = Callable[[float, bool], "tuple[NDArray[np.float64], Packets | None]"]
"""Computes the directions (samples, lines, 3) of a reading that begins at this time along the path [s]; and their
packets, where they are of use and there already."""


class Steered(Spec):
    """A beam, or several on lines of their own, sampled at a constant rate along a path in time."""

    sample_rate_hz: float = Field(gt=0, description="measurements of each line per second [Hz]")
    line_elevation_deg: Takes[Numbers, Sequence[float]] = optional(
        default=(0.0,), min_length=1, description="elevation of each line before it is deflected [deg]"
    )
    start: float = Field(default=0.0, description="position along the beam's path at time 0 [s]")

    def samples(self, rate_hz: float) -> int:
        """Number of measurements of each line in a reading, which ends before the next one begins."""
        return int(min(self.sample_rate_hz / rate_hz * (1 + 1e-9), 2.0**53))

    def pattern(self, rate_hz: float) -> Pattern:
        """Rays (samples * lines,), in the order of their times; ring is the line, column the sample."""
        samples, lines = self.samples(rate_hz), len(self.line_elevation_deg)
        column, ring = (index.ravel() for index in np.indices((samples, lines), dtype=np.int32))
        sampled = np.arange(samples) / self.sample_rate_hz
        fired = np.repeat(sampled, lines)
        make_aim = cache(partial(self.aim, samples))  # made only if later readings are needed

        def pattern_of(directions: NDArray[np.float64], packets: "Packets | None" = None) -> Pattern:
            rays = directions.reshape(-1, 3)
            return Pattern(rays, firing_times=fired, ring=ring, column=column, later=at, packets=packets)

        def at(time: float, in_packets: bool) -> Pattern:
            return pattern_of(*make_aim()(self.start + time, in_packets))

        return pattern_of(self.directions(self.start + sampled))

    @abstractmethod
    def directions(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unit directions (n, lines, 3) of each line at times (n,) [s] along the path."""

    def aim(self, samples: int) -> Aim:
        """The Aim of successive readings of `samples` samples."""
        sampled = np.arange(samples) / self.sample_rate_hz
        return lambda begin, _: (self.directions(begin + sampled), None)


class Wedge(Spec):
    """A rotating wedge of glass in air, one face perpendicular to the x axis and the other tilted."""

    rpm: float = Field(description="revolutions per minute about +x, by the right-hand rule")
    tilt_deg: float = Field(gt=-90, lt=90, description="angle of the tilted face [deg]; it leans to +y at time 0")
    index: float = Field(ge=1, description="refractive index of the glass")
    tilted_first: bool = Field(description="whether the light meets the tilted face first")

    @property
    def speed(self) -> float:
        """Angular speed, counter-clockwise [rad/s]."""
        return 2 * np.pi * self.rpm / 60

    def bend(self, beam: NDArray[np.float64], time: NDArray[np.float64]) -> None:
        """Refract unit directions (3, lines, n) by the wedge at times (n,) [s], in place."""
        tilt, turned = np.deg2rad(self.tilt_deg), self.speed * time
        leaning = np.cos(tilt), np.sin(tilt) * np.cos(turned), np.sin(tilt) * np.sin(turned)
        if self.tilted_first:
            refract(beam, leaning, 1.0, self.index)
            refract_at_x(beam, self.index, 1.0)
        else:
            refract_at_x(beam, 1.0, self.index)
            refract(beam, leaning, self.index, 1.0)


class Rosette(Steered):
    """Beams along +x, each at its line's elevation, refracted by rotating wedges one after the other.

    >>> Rosette(
    ...     wedges=[
    ...         Wedge(rpm=7294, tilt_deg=-18, index=1.5089, tilted_first=False),
    ...         Wedge(rpm=-4664, tilt_deg=18, index=1.5089, tilted_first=True),
    ...     ],
    ...     sample_rate_hz=100_000,
    ... )
    """

    wedges: Takes[Sequence[Wedge | Keys], Sequence[Wedge]] = Field(
        min_length=1, description="the wedges, in the light's order"
    )

    @model_validator(mode="after")
    def _lets_light_through(self) -> "Rosette":
        # Beat frequencies make wedges meet at every angle: a coarse grid of one wedge against the others finds a
        # configuration that reflects all of the light.
        times = np.arange(4096) / 4096 * 60 / max(min(abs(wedge.rpm) for wedge in self.wedges), 1.0)
        if not np.isfinite(self.directions(times)).all():
            raise ValueError("the wedges reflect the beam instead of bending it, expected smaller tilts or indices")
        return self

    def directions(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        lines = self._lines()
        beam = np.empty((3, len(lines), len(time)))
        beam[:] = lines.T[..., None]
        for wedge in self.wedges:
            wedge.bend(beam, time)
        return np.ascontiguousarray(beam.T)

    def aim(self, samples: int) -> Aim:
        from rigcast.kernels.packing.wedges import (  # here, as cards of devices are drawn without Warp
            Bending,
            TurningWedge,
        )

        wedges = [
            TurningWedge(np.deg2rad(w.tilt_deg), w.index, w.tilted_first, w.speed / self.sample_rate_hz)
            for w in self.wedges
        ]
        bending = Bending(self._lines(), wedges, samples)
        return lambda begin, in_packets: bending.reading([w.speed * begin for w in self.wedges], in_packets)

    def _lines(self) -> NDArray[np.float64]:
        """Unit directions (lines, 3) before the wedges."""
        elevation = np.deg2rad(np.asarray(self.line_elevation_deg))
        return directions_at(np.zeros_like(elevation), elevation)


class Nodding(Steered):
    """Beams that rotate about z while they nod: a line's angles [deg] at time t [s], with p = 2 pi nod_hz t, are

    elevation = elevation_deg[0] + elevation_deg[1] cos p + elevation_deg[2] cos 2p + ... + the line's own
    azimuth = azimuth_deg[0] + 6 spin_rpm t + azimuth_deg[1] sin p + azimuth_deg[2] sin 2p + ...
    """

    spin_rpm: float = Field(description="revolutions about z per minute, counter-clockwise")
    nod_hz: float = Field(description="nods per second [Hz]")
    elevation_deg: Takes[Numbers, Sequence[float]] = Field(
        min_length=1, description="mean elevation and cosine coefficients [deg]"
    )
    azimuth_deg: Takes[Numbers, Sequence[float]] = optional(
        default=(0.0,), min_length=1, description="as elevation_deg, with sines [deg]"
    )

    def directions(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        phase = 2 * np.pi * self.nod_hz * time
        elevation = sum(a * np.cos(m * phase) for m, a in enumerate(self.elevation_deg))
        swing = sum(a * np.sin(m * phase) for m, a in enumerate(self.azimuth_deg) if m)
        azimuth = self.azimuth_deg[0] + 6.0 * self.spin_rpm * time + swing
        lines = np.asarray(elevation)[:, None] + np.asarray(self.line_elevation_deg)
        return directions_at(np.deg2rad(azimuth)[:, None], np.deg2rad(lines))


def refract(k: NDArray[np.float64], normal: Sequence[Coordinate], before: float, behind: float) -> None:
    """Refract vectors k (3, ...) at a face between media of these indices, in place; NaN at total reflection.

    normal: x, y and z of the face's normal. Coordinates come first because numpy is slow along an axis of 3.
    """
    along = k[0] * normal[0] + k[1] * normal[1] + k[2] * normal[2]
    with np.errstate(invalid="ignore"):
        turn = np.sqrt(along**2 + (behind**2 - before**2)) - along
    for coordinate, leaning in zip(k, normal, strict=True):
        coordinate += turn * leaning


def refract_at_x(k: NDArray[np.float64], before: float, behind: float) -> None:
    """`refract` at a face whose normal is the x axis."""
    with np.errstate(invalid="ignore"):
        k[0] = np.sqrt(k[0] ** 2 + (behind**2 - before**2))
