"""Principles by which depth cameras measure depth, and their errors. Every error is off unless it is set."""

import math
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator

from rigcast.sensors.specs.sensor_spec import no_default
from rigcast.sensors.specs.spec import Share, Spec


class Ranging(Spec):
    """Parameters of all principles of measurement: pixels that give no reading (NaN)."""

    dropout: Share = Field(default=0.0, description="share of pixels without a reading, at random")
    max_incidence_deg: float = Field(
        default=90.0, gt=0, le=90, description="surfaces at a greater angle of incidence have no reading [deg]"
    )
    min_intensity: float = Field(
        default=0.0,
        ge=0,
        description="darker pixels, by infrared intensity, have no reading; 1 is a white surface that faces the "
        "camera at 1 m, 1/4 the same at 2 m",
    )


class Stereo(Ranging):
    """Depth from disparity, d = fx |baseline| / z, between the camera and a second imager or a projector.

    The error of depth grows with the square of the depth: sigma_z = z^2 disparity_std / (fx |baseline|).

    >>> Stereo(baseline=0.05, disparity_std=0.08, disparity_step=1 / 32, max_disparity=126, shadow=True)
    """

    baseline: float = Field(
        description="position of the second imager or projector along the camera's x axis [m]; negative: to the left"
    )
    disparity_std: float = Field(default=0.0, ge=0, description="standard deviation of the disparity [pixels]")
    disparity_step: float = Field(default=0.0, ge=0, description="the disparity is a multiple of this [pixels]; 0: any")
    max_disparity: float = Field(
        default=math.inf,
        gt=0,
        allow_inf_nan=True,
        description="surfaces of greater disparity, which are nearer, read as -inf [pixels]; unlimited if not given",
        json_schema_extra=no_default,
    )
    shadow: bool = Field(
        default=False,
        description="whether points that the second imager does not see, hidden or outside its image (as large as the "
        "camera's own), have no reading",
    )
    matching_window: int = Field(
        default=1, ge=1, description="side of the matched square [pixels], odd; edges grow by half of it"
    )
    untextured_dropout: Share = Field(
        default=0.0, description="share of pixels without a reading on surfaces whose material has no texture"
    )
    kinect_v1: Literal["nguyen", "disparity"] | None = Field(
        default=None,
        description="the error of the first Kinect, axial and lateral, as Nguyen et al. (2012) measured it or as "
        "Barron and Malik (2013) model its disparity; replaces disparity_std and disparity_step",
    )

    @field_validator("baseline")
    @classmethod
    def _apart(cls, baseline: float) -> float:
        if baseline == 0:
            raise ValueError("must not be 0")
        return baseline

    @field_validator("matching_window")
    @classmethod
    def _odd(cls, window: int) -> int:
        if window % 2 == 0:
            raise ValueError(f"must be odd, got {window}")
        return window

    @field_validator("kinect_v1")
    @classmethod
    def _alone(cls, model: str | None, info: ValidationInfo) -> str | None:
        both = [key for key in ("disparity_std", "disparity_step") if info.data.get(key)]
        if model is not None and both:
            raise ValueError(f"replaces {' and '.join(both)}, expected one or the other")
        return model


class TimeOfFlight(Ranging):
    """Depth from the time that light takes; errors are along the ray.

    >>> TimeOfFlight(range_std=0.017, bias=0.011, bias_per_metre=0.001, subrays=3)
    """

    range_std: float = Field(default=0.0, ge=0, description="standard deviation of the range [m]")
    bias: float = Field(default=0.0, description="added to every range [m]")
    bias_per_metre: float = Field(default=0.0, gt=-1, description="share of the range that is added to it [m/m]")
    subrays: int = Field(
        default=1,
        ge=1,
        le=8,
        description="a pixel is cast as a grid of this many by this many rays and reads the mean of their ranges, "
        "weighted by intensity, which makes flying pixels at edges",
    )
    modulation_hz: float | None = Field(
        default=None, gt=0, description="ranges wrap at c / (2 modulation_hz) [Hz]; null: no wrapping"
    )
