"""Lidars: spinning, 2D and solid-state ones with a table of beams, rosettes, and rays from arrays and files."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Annotated, Any, ClassVar, Literal

import mujoco
from pydantic import Field, ValidationInfo, field_validator, model_validator

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import Fault
from rigcast.sensors.specs.pattern import Pattern, refuse_too_many
from rigcast.sensors.specs.sensor_spec import SensorSpec, no_default
from rigcast.sensors.specs.spec import Keys, Numbers, Takes, optional

from .beam_table import BeamTable
from .effects import Beam, Detection, Noise, Weather
from .ray_arrays import RayArrays
from .ray_file import RayFile
from .rosette import Nodding, Rosette

_PER_ROW = ("azimuth_offset_deg", "firing_time_us", "origin_height")
_TABLE = frozenset(field.name for field in fields(BeamTable)) - {"rate_hz"}
_PATHS = ("rosette", "nodding", "rays", "ray_file")


class Lidar(SensorSpec):
    """A lidar. Its rays are a table of beams, a `rosette`, a `nodding` beam, `rays` given one by one, or a `ray_file`.

    Directions: a table has `len(elevation_deg)` beams, each measured in `columns` directions around +z; readings have
    shape (beams, columns). Azimuth 0 is +x, counter-clockwise. Column k of n is at 360 k / n deg, or in a sector at
    from + (to - from) k / (n - 1), so that both ends are measured; a single column is at from. In a sector of 360 deg
    both ends are one direction, which is measured once: column k is at from + 360 k / n deg. `clockwise` reverses the
    order: column k is at -360 k / n deg, or a sector of several columns begins at its other end. With
    `column_period_us` p instead of `columns`, column k is at 360 k p rate_hz deg, and there are as many columns as fit
    into a turn. Readings of the other patterns have shape (rays,).

    Times: with `rate_hz` the head turns at that rate. Column k of n fires k / (n rate_hz) s after the first (in a
    sector, when the head gets there), and row i `firing_time_us[i]` later, when the head has turned further.
    `scan_time` is for devices that take another time for a sector, or none. Without `rate_hz` and `scan_time` all
    columns fire at once. With `motion` each ray is cast with the poses of sensor and geoms at its firing time, and its
    point is in the sensor's frame at that time.

    Origins: a beam starts `origin_radius` [m] from the z axis, towards its column's azimuth without the row's offset,
    at `origin_height` [m]. `min_range` and `max_range` limit the distance along the ray from there.

    Errors: the lidar is ideal unless one of the options from `noise` on is set. With `returns: dual` readings have a
    last axis of 2: the strongest return, then the last, or if that is the same the second strongest.

    >>> Lidar(name="own", mount=Mount(body="torso"), elevation_deg=[-15, 0, 15], columns=1024, rate_hz=10)
    """

    _alternatives: ClassVar[tuple[frozenset[str], ...]] = (_TABLE, *(frozenset({key}) for key in _PATHS))

    type: Literal["lidar"] = "lidar"
    elevation_deg: Takes[Numbers, Sequence[Annotated[float, Field(ge=-90, le=90)]]] = optional(
        default=(),
        min_length=1,
        description="elevation of each row above the x-y plane [deg]; required without a preset",
        json_schema_extra=no_default,
    )
    azimuth_offset_deg: Takes[Numbers | None, Sequence[float] | None] = optional(
        default=None, description="added to the azimuth of each row [deg], one value per row; null: 0"
    )
    columns: int = Field(
        default=0,
        ge=1,
        le=100_000,
        description="measurements per row in a turn or sector; required without a preset",
        json_schema_extra=no_default,
    )
    column_period_us: float | None = Field(
        default=None, gt=0, description="time from one column to the next [us], instead of columns; needs rate_hz"
    )
    azimuth_deg: Takes[Numbers | None, tuple[float, float] | None] = optional(
        default=None,
        description="azimuth of the first and of the last column [deg], without the last where they are 360 apart; "
        "null: evenly over a full turn",
    )
    clockwise: bool = Field(default=False, description="whether columns follow each other clockwise, seen from above")
    firing_time_us: Takes[Numbers | None, Sequence[Annotated[float, Field(ge=0)]] | None] = optional(
        default=None, description="when each row fires after the first one of its column [us]; null: all rows at once"
    )
    scan_time: float | None = Field(
        default=None,
        ge=0,
        description="time from the first column to the last [s]; null: follows from the head's rotation",
    )
    motion: bool = Field(
        default=False,
        description="whether sensor and geoms move during a reading of rig.step; each ray is cast with the poses at "
        "its own time",
    )
    origin_radius: float = Field(default=0.0, ge=0, description="distance of the beams' origins from the z axis [m]")
    origin_height: Takes[Numbers | None, Sequence[float] | None] = optional(
        default=None, description="height of the origin of each row [m], one value per row; null: 0"
    )
    rosette: Takes[Rosette | Keys | None, Rosette | None] = optional(
        default=None, description="beams steered by rotating wedges, instead of a table"
    )
    nodding: Takes[Nodding | Keys | None, Nodding | None] = optional(
        default=None, description="beams that rotate and nod, instead of a table"
    )
    rays: Takes[RayArrays | Keys | None, RayArrays | None] = optional(
        default=None, description="rays given one by one, instead of a table"
    )
    ray_file: Takes[RayFile | Keys | None, RayFile | None] = optional(
        default=None, description="a file of rays, instead of a table"
    )

    noise: Takes[Noise | Keys | None, Noise | None] = optional(
        default=None, description="errors of ray direction and range, and returns lost at random"
    )
    detection: Takes[Detection | Keys | None, Detection | None] = optional(
        default=None, description="how far dark surfaces are detected, and how accurately"
    )
    beam: Takes[Beam | Keys | None, Beam | None] = optional(
        default=None, description="the beam's divergence, with mixed pixels at edges"
    )
    returns: Literal["first", "last", "strongest", "dual"] = Field(
        default="strongest", description="which of a beam's returns are reported; dual: strongest and last"
    )
    pulse_length: float = Field(
        default=5e-9, gt=0, le=1e-6, description="tau [s]: echoes less than c tau / 2 apart are one return"
    )
    max_surfaces: int = Field(
        default=1,
        ge=1,
        le=4,
        description="number of surfaces that a beam meets one behind the other, if they are transparent",
    )
    mirrors: bool = Field(default=False, description="whether mirrors show reflections")
    mirror_lobe_deg: float = Field(
        default=0.5,
        ge=0,
        le=90,
        description="angle of incidence up to which a mirror reflects light back to the sensor [deg]",
    )
    weather: Takes[Weather | Keys | None, Weather | None] = optional(default=None, description="rain and fog")

    @field_validator(*_PER_ROW)
    @classmethod
    def _one_value_per_row(cls, values: Sequence[float] | None, info: ValidationInfo) -> Sequence[float] | None:
        rows = len(info.data.get("elevation_deg", ()))
        if values is not None and rows and len(values) != rows:
            raise ValueError(f"must have one value per row of elevation_deg, {rows}, got {len(values)}")
        return values

    @field_validator("azimuth_deg")
    @classmethod
    def _forwards(cls, sector: tuple[float, float] | None) -> tuple[float, float] | None:
        if sector is not None and not 0 < sector[1] - sector[0] <= 360:
            raise ValueError(f"must be [from, to] with from < to <= from + 360, got {list(sector)}")
        return sector

    @model_validator(mode="after")
    def _has_optics(self) -> "Lidar":
        paths = [key for key in _PATHS if getattr(self, key) is not None]
        others = sorted(_TABLE & self.model_fields_set) if paths else []
        if len(paths) + len(others) > 1:
            raise ValueError(f"give a table of beams, or one of {', '.join(_PATHS)}, got {', '.join(others + paths)}")
        if paths:
            return self._path_fits()
        columns = bool(self.columns) + (self.column_period_us is not None)
        missing = ["elevation_deg"] * (not self.elevation_deg) + ["columns"] * (not columns)
        if missing:
            which = "them" if len(missing) > 1 else "it"
            raise ValueError(f"{' and '.join(missing)}: required where no preset gives {which}")
        if columns > 1:
            raise ValueError("give columns or column_period_us, got both")
        return self._table_fits()

    def _path_fits(self) -> "Lidar":
        steered = self.rosette or self.nodding
        if steered is not None and self.rate_hz is None:
            raise ValueError("rosette and nodding need rate_hz, got none")
        if steered is not None and self.rate_hz is not None:
            samples = steered.samples(self.rate_hz)
            if not samples:
                raise ValueError(f"sample_rate_hz: must be at least rate_hz, {self.rate_hz:g} Hz")
            refuse_too_many(samples * len(steered.line_elevation_deg))
        misfit = self.rays.misfit(self.rate_hz) if self.rays is not None else None
        if misfit is not None:
            raise ValueError(f"rays: {misfit}")
        return self

    def _table_fits(self) -> "Lidar":
        turns = self.rate_hz is not None and self.azimuth_deg is None and self.scan_time is None
        if self.column_period_us is not None and not turns:
            raise ValueError("column_period_us is for full turns at rate_hz, expected columns in place of it")
        if self._beams.column_count < 1:
            raise ValueError(f"column_period_us: must be at most 1 / rate_hz, got {self.column_period_us:g} us")
        refuse_too_many(self._beams.column_count * len(self.elevation_deg))
        duration = self._beams.duration
        if self.rate_hz is not None and duration * self.rate_hz > 1 + 1e-9:
            raise ValueError(
                f"a reading takes {duration:g} s, longer than 1 / rate_hz, {1 / self.rate_hz:g} s; "
                "expected fewer columns, or shorter scan_time or firing_time_us"
            )
        return self

    @classmethod
    def _replaced(cls, given: dict[str, Any]) -> set[str]:
        """The keys replaced for every sensor, those of a preset's own rows, and the other key for columns."""
        replaced = super()._replaced(given) | (set(_PER_ROW) if "elevation_deg" in given else set())
        either = {"columns", "column_period_us"}
        return replaced | (either if either & given.keys() else set())

    def faults(self, model: mujoco.MjModel) -> list[Fault]:
        """The faults of every sensor, and those of an unusable file of rays."""
        faults = super().faults(model)
        if self.ray_file is not None:
            try:
                self.ray_file.pattern(self.rate_hz, self.phase)
            except InputError as error:
                faults.append(Fault(("ray_file", "path"), str(error)))
        return faults

    @model_validator(mode="after")
    def _weather_on_detection(self) -> "Lidar":
        if self.weather is not None and self.detection is None:
            raise ValueError("weather needs detection, the power below which a return is lost, got none")
        return self

    @property
    def has_effects(self) -> bool:
        """Whether readings depend on more than the first surface in range."""
        given = (self.noise, self.detection, self.beam, self.weather)
        return any(given) or self.returns == "dual" or self.max_surfaces > 1 or self.mirrors

    @property
    def moves(self) -> bool:
        """Whether sensor and geoms move during a reading: `motion`."""
        return self.motion

    @property
    def returns_per_ray(self) -> int:
        """Number of returns of each ray in a frame: 2 with `returns: dual`."""
        return 2 if self.returns == "dual" else 1

    @property
    def _beams(self) -> BeamTable:
        return BeamTable(**{key: getattr(self, key) for key in _TABLE}, rate_hz=self.rate_hz)

    def pattern(self, model: mujoco.MjModel) -> Pattern:  # noqa: ARG002
        """Unit directions (beams, columns, 3) or (rays, 3), x forward and z up, with ring and column of each.

        Raises InputError for a file of rays that cannot be used.
        """
        steered = self.rosette or self.nodding
        if steered is not None and self.rate_hz is not None:
            return steered.pattern(self.rate_hz)
        rows = self.rays or self.ray_file
        if rows is not None:
            return rows.pattern(self.rate_hz, self.phase)
        return self._beams.pattern()
