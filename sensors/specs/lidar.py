"""Spinning lidars and other scanners with a fixed table of beams."""

from collections.abc import Sequence
from typing import Annotated, Literal

import mujoco
import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from .lidar_effects import Beam, Detection, Noise, Weather
from .pattern import Pattern
from .sensor_spec import SensorSpec, no_default


class Lidar(SensorSpec):
    """A lidar: `len(elevation_deg)` beams, each measured in `columns` directions around +z.

    Azimuth 0 is +x, counter-clockwise. Column k of n is at 360 k / n deg, or, in a sector, at
    from + (to - from) k / (n - 1), so that both ends are measured. Readings have shape (beams, columns).
    `min_range` and `max_range` bound the distance along the ray.

    Nothing disturbs the readings unless an option from `noise` on says so. With `returns: dual` readings have shape
    (beams, columns, 2): the strongest return, then the last, or where that is the same the second strongest.

    >>> Lidar(name="own", mount=Mount(body="torso"), elevation_deg=[-15, 0, 15], columns=1024, rate_hz=10)
    """

    type: Literal["lidar"] = "lidar"
    elevation_deg: Sequence[Annotated[float, Field(ge=-90, le=90)]] = Field(
        default=(),
        min_length=1,
        description="elevation of each row above the x-y plane [deg]; required where no preset is given",
        json_schema_extra=no_default,
    )
    azimuth_offset_deg: Sequence[float] | None = Field(
        default=None, description="added to the azimuth of each row [deg], one value per row; null: 0"
    )
    columns: int = Field(
        default=0,
        ge=1,
        le=100_000,
        description="measurements per row and turn; required where no preset is given",
        json_schema_extra=no_default,
    )
    azimuth_deg: tuple[float, float] | None = Field(
        default=None, description="first and last azimuth of a sector [deg]; null: a full turn"
    )

    noise: Noise | None = Field(default=None, description="errors of ray and range, and returns lost at random")
    detection: Detection | None = Field(default=None, description="how far dark surfaces are seen, and how exactly")
    beam: Beam | None = Field(default=None, description="the beam's divergence, with mixed pixels at edges")
    returns: Literal["first", "last", "strongest", "dual"] = Field(
        default="strongest", description="which of a beam's returns are reported; dual: strongest and last"
    )
    pulse_length: float = Field(
        default=5e-9, gt=0, le=1e-6, description="tau [s]: echoes less than c tau / 2 apart are one return"
    )
    max_surfaces: int = Field(
        default=1, ge=1, le=4, description="surfaces that a beam meets one behind the other, where they are transparent"
    )
    mirrors: bool = Field(default=False, description="whether mirror-like surfaces show what is seen in them")
    mirror_lobe_deg: float = Field(
        default=0.5,
        ge=0,
        le=90,
        description="angle of incidence up to which a mirror sends light back to the sensor [deg]",
    )
    weather: Weather | None = Field(default=None, description="rain and fog")

    @field_validator("azimuth_offset_deg")
    @classmethod
    def _one_offset_per_row(cls, offsets: Sequence[float] | None, info: ValidationInfo) -> Sequence[float] | None:
        rows = len(info.data.get("elevation_deg", ()))
        if offsets is not None and rows and len(offsets) != rows:
            raise ValueError(f"must have one value per row of elevation_deg, {rows}, got {len(offsets)}")
        return offsets

    @field_validator("azimuth_deg")
    @classmethod
    def _forwards(cls, sector: tuple[float, float] | None) -> tuple[float, float] | None:
        if sector is not None and not 0 < sector[1] - sector[0] <= 360:
            raise ValueError(f"must be [from, to] with from < to <= from + 360, got {list(sector)}")
        return sector

    @model_validator(mode="after")
    def _has_optics(self) -> "Lidar":
        missing = [key for key in ("elevation_deg", "columns") if not getattr(self, key)]
        if missing:
            raise ValueError(f"{' and '.join(missing)}: required where no preset is given")
        return self

    @model_validator(mode="after")
    def _weather_on_detection(self) -> "Lidar":
        if self.weather is not None and self.detection is None:
            raise ValueError("weather needs detection, the power below which a return is lost, got none")
        return self

    @property
    def has_effects(self) -> bool:
        """Whether anything but the first surface in range counts for a reading."""
        given = (self.noise, self.detection, self.beam, self.weather)
        return any(given) or self.returns == "dual" or self.max_surfaces > 1 or self.mirrors

    def pattern(self, model: mujoco.MjModel) -> Pattern:  # noqa: ARG002
        """Unit directions (beams, columns, 3), x forward and z up, with ring (row) and column of each."""
        elevation = np.deg2rad(self.elevation_deg)[:, None]
        offset = (
            np.zeros_like(elevation)
            if self.azimuth_offset_deg is None
            else np.deg2rad(self.azimuth_offset_deg)[:, None]
        )
        if self.azimuth_deg is None:
            sweep = np.arange(self.columns) * (2 * np.pi / self.columns)
        else:
            sweep = np.deg2rad(np.linspace(*self.azimuth_deg, self.columns))
        azimuth, elevation = np.broadcast_arrays(sweep + offset, elevation)
        flat = np.cos(elevation)
        directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
        rings_columns = np.indices(azimuth.shape, dtype=np.int32)
        return Pattern(directions, ring=rings_columns[0], column=rings_columns[1])
