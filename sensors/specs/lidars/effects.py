"""Measurement effects of real lidars, each an option of `Lidar` that is off unless given."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from rigcast.sensors.specs.sensor_spec import no_default
from rigcast.sensors.specs.spec import Numbers, Share, Spec, Takes, optional

_Angle = Annotated[float, Field(gt=0, le=10)]


class Noise(Spec):
    """Errors of the ray's direction and of the range, and returns lost at random.

    Points and `points_world` lie on the nominal rays, without the angular noise.
    """

    range_std: float = Field(default=0.0, ge=0, description="standard deviation of the range, at any range [m]")
    range_resolution: float = Field(default=0.0, ge=0, description="ranges are multiples of this [m]; 0: not rounded")
    angle_std_deg: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="standard deviation of the ray's azimuth on the sphere and elevation [deg]",
    )
    dropout: Share = Field(default=0.0, description="probability that a return is lost")
    dark_dropout: Share = Field(
        default=0.0, description="probability that a return of intensity 0 is lost; it falls linearly with intensity"
    )
    dark_limit: float = Field(default=0.8, gt=0, description="intensity from which on dark_dropout loses no returns")


class Detection(Spec):
    """Detection range and accuracy for dark and slanted surfaces, from two figures of a data sheet.

    The received power rho cos(theta) exp(-2 a R) / R^2 of a target with `reflectivity` facing the sensor at `range`
    is the least that is detected. With `accuracy`, the range of a return of power P has a standard deviation in
    proportion to sqrt(1 / P) that is `accuracy` at `accuracy_range` on a target of `accuracy_reflectivity`.
    """

    range: float = Field(ge=1e-3, le=1e6, description="range at which a target is just detected [m]")
    reflectivity: float = Field(default=0.1, gt=0, le=1, description="reflectivity of that target")
    accuracy: float | None = Field(
        default=None,
        gt=0,
        description="standard deviation of the range at accuracy_range [m]; null: no error that depends on power",
    )
    accuracy_range: float | None = Field(default=None, gt=0, description="range at which accuracy holds [m]")
    accuracy_reflectivity: float = Field(
        default=0.1, gt=0, le=1, description="reflectivity of the target on which accuracy holds"
    )

    @model_validator(mode="after")
    def _accuracy_somewhere(self) -> "Detection":
        if (self.accuracy is None) != (self.accuracy_range is None):
            given = "accuracy" if self.accuracy_range is None else "accuracy_range"
            raise ValueError(f"give both of accuracy and accuracy_range, or neither, got only {given}")
        return self

    @property
    def least_power(self) -> float:
        """The least detected power P_min = rho / R^2, relative to a white target at 1 m."""
        return self.reflectivity / self.range**2

    @property
    def power_std(self) -> float:
        """Standard deviation [m] of the range of a return with the power of a white target at 1 m.

        In sigma = dR / sqrt(2 P / P_min) this is dR sqrt(P_min / 2).
        """
        if self.accuracy is None or self.accuracy_range is None:
            return 0.0
        return self.accuracy * math.sqrt(self.accuracy_reflectivity) / self.accuracy_range


class Beam(Spec):
    """A diverging beam, cast as sub-rays whose echoes mix at edges or are separated into several returns."""

    divergence_deg: Takes[Numbers, tuple[_Angle, _Angle]] = Field(
        description="full width across and up at 1 / e^2 of the irradiance [deg]; 1 mrad is 0.0573 deg"
    )
    rings: int = Field(
        default=2, ge=1, le=6, description="number of rings of 6, 12, 18, ... sub-rays around the middle one"
    )


class Weather(Spec):
    """Rain and fog along the beam: they attenuate it and return echoes of their own. Needs `detection`."""

    rain_rate: float = Field(default=0.0, ge=0, le=500, description="rain [mm/h]")
    rain_extinction: Takes[Numbers | None, tuple[Annotated[float, Field(ge=0)], float] | None] = optional(
        default=None,
        description="a and b of an extinction a r^b [1/m] in rain of r mm/h; null: computed from the drops",
    )
    rain_range_noise: float = Field(
        default=0.0,
        ge=0,
        description="k of a range error with standard deviation k (1 - exp(-r))^2 times the range, in rain of r mm/h",
    )
    visibility: float = Field(
        default=math.inf,
        ge=5,
        allow_inf_nan=True,
        description="meteorological range of fog [m]; unlimited if not given",
        json_schema_extra=no_default,
    )
