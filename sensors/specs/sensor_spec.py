"""Parameters of every sensor: name, mount, filter, rate, range limits."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self, cast

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic.config import JsonDict

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import Fault, faults_of
from rigcast.sensors.names import listing
from rigcast.sensors.yaml.file import YamlFile

from .filter import Filter
from .mount import Alignment, Mount
from .pattern import Pattern
from .presets import load_preset, preset_names
from .spec import Keys, Share, Spec, Takes, folder_of, optional


def no_default(schema: JsonDict) -> None:
    """Omit a default from the JSON schema: JSON has no infinity, and no value for "from the preset"."""
    schema.pop("default", None)


def _list_presets(schema: JsonDict) -> None:
    schema["examples"] = list(preset_names())


def _require_type(schema: JsonDict) -> None:
    # In Python the class determines the type; a file must give it.
    schema["required"] = ["type", *cast("list[str]", schema["required"])]


class SensorSpec(Spec):
    """The base of all sensors.

    frame_rotation: (3, 3), the axes of the sensor's frame as columns in the mount's. The sensor's pose is the
        mount's times this, and `Pattern.directions` are in the frame that results.
    """

    model_config = ConfigDict(json_schema_extra=_require_type)

    frame_rotation: ClassVar[NDArray[np.float64]] = np.eye(3)
    # Alternative sets of keys for the same thing: giving a key of one set drops the preset's other sets.
    _alternatives: ClassVar[tuple[frozenset[str], ...]] = ()

    type: str
    name: str = Field(
        pattern=r"^[A-Za-z0-9_-]{1,64}$",
        description="unique in the rig; letters, digits, _ and -, as it names a folder and topics",
    )
    preset: str | None = Field(
        default=None,
        description="device whose figures are the defaults of all other keys: its name, or a .yaml file beside the rig",
        json_schema_extra=_list_presets,
    )
    mount: Takes[Mount | Keys, Mount] = Field(description="where the sensor is")
    filter: Takes[Filter | Keys, Filter] = optional(default=Filter(), description="which geoms its rays may hit")
    rate_hz: float | None = Field(default=None, gt=0, description="readings per second [Hz]; null: every step")
    phase: float = Field(default=0.0, ge=0, description="when the first reading after time 0 begins [s]")
    latency: float = Field(default=0.0, ge=0, description="how long after its time a reading is returned [s]")
    jitter: float = Field(
        default=0.0, ge=0, description="largest time by which a reading begins early or late [s], uniformly distributed"
    )
    frame_loss: Share = Field(default=0.0, description="share of readings lost at random")
    min_range: float = Field(default=0.0, ge=0, description="nearer hits read as -inf [m]")
    max_range: float = Field(
        default=math.inf,
        gt=0,
        allow_inf_nan=True,
        description="farther hits read as +inf [m]; unlimited if not given",
        json_schema_extra=no_default,
    )

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:  # noqa: ARG002
        """A copy with the values of `update` in place of its own and its preset's.

        Raises InputError for values that the constructor refuses, and for another preset.
        """
        given = dict(update or {})
        if self.preset is not None and given.pop("preset", self.preset) != self.preset:
            raise InputError(f"{type(self).__name__} {self.name!r}: preset: got another, expected {self.preset!r}")
        own = {key: getattr(self, key) for key in self.model_fields_set - {"preset"}}
        changed = type(self)(**self._over(given, own))
        # the preset is named but not read again: its values are filled in, and its file is relative to the rig's file
        return changed if self.preset is None else BaseModel.model_copy(changed, update={"preset": self.preset})

    @property
    def frame_alignment(self) -> Alignment:
        """What the sensor's frame keeps of the mount's rotation."""
        return "base"

    @property
    def moves(self) -> bool:
        """Whether sensor and geoms move during a reading; else the world stands still."""
        return False

    @property
    def returns_per_ray(self) -> int:
        """Number of returns of each ray in a frame."""
        return 1

    @abstractmethod
    def pattern(self, model: mujoco.MjModel) -> Pattern:
        """The rays of one reading, for a sensor mounted on `model`."""

    def faults(self, model: mujoco.MjModel) -> list[Fault]:
        """Faults that prevent mounting this sensor on `model`, with their places in this specification."""
        mount = [fault.under("mount") for fault in self.mount.faults(model)]
        return mount + [fault.under("filter") for fault in self.filter.faults(model)]

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any, info: ValidationInfo) -> Any:
        if not isinstance(given, dict) or not isinstance(given.get("preset"), str):
            return given
        try:
            return cls._over(given, cls._preset_keys(given["preset"], folder_of("preset", info)))
        except InputError:  # reported by the validator of `preset`, at its place
            return given

    @classmethod
    def _preset_keys(cls, name: str, folder: Path | None) -> dict[str, Any]:
        """The values of a preset. Raises InputError if it does not exist or is not for this type of sensor."""
        preset, own = load_preset(name, folder), _type_of(cls)
        if preset.type != own:
            fitting = [other for other in preset_names() if load_preset(other).type == own]
            raise InputError(f"{name!r} is a {preset.type}, expected a {own}: {listing(fitting)}")
        keys: dict[str, Any] = {}
        for each in preset.lineage():
            keys = cls._over(keys, each.sensor)
        if preset.file is not None:
            _refuse_values(cls, preset.file, preset.sensor, keys)
        return keys

    @classmethod
    def _over(cls, given: dict[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
        """The `given` keys, and those of `base` that they do not replace."""
        return {**{key: base[key] for key in base.keys() - cls._replaced(given)}, **given}

    @classmethod
    def _replaced(cls, given: dict[str, Any]) -> set[str]:
        """Keys whose preset values must not be mixed with the `given` ones."""
        chosen = [group for group in cls._alternatives if group & given.keys()]
        return {key for group in cls._alternatives if chosen and group not in chosen for key in group}

    @field_validator("preset")
    @classmethod
    def _known_preset(cls, name: str | None, info: ValidationInfo) -> str | None:
        if name is not None:
            cls._preset_keys(name, folder_of("preset", info))
        return name

    @model_validator(mode="after")
    def _timed(self) -> "SensorSpec":
        if self.rate_hz is None:
            given = [key for key in ("phase", "jitter") if getattr(self, key)]
            if given:
                raise ValueError(f"{' and '.join(given)}: needs rate_hz, got none, which is every step")
        elif self.phase * self.rate_hz >= 1:
            raise ValueError(f"phase: must be below 1 / rate_hz, {1 / self.rate_hz:g} s, got {self.phase:g} s")
        elif self.jitter * self.rate_hz >= 0.5:
            raise ValueError(f"jitter: must be below 0.5 / rate_hz, {0.5 / self.rate_hz:g} s, got {self.jitter:g} s")
        return self

    @field_validator("max_range")
    @classmethod
    def _above_minimum(cls, max_range: float, info: ValidationInfo) -> float:
        min_range = info.data.get("min_range", 0.0)
        if max_range <= min_range:
            raise ValueError(f"must be above min_range, {min_range:g} m, got {max_range:g} m")
        return max_range


def _type_of(cls: type[SensorSpec]) -> str:
    return str(cls.model_fields["type"].default)


def _refuse_values(cls: type[SensorSpec], file: YamlFile, own: Mapping[str, Any], keys: dict[str, Any]) -> None:
    """Raise InputError, with lines and columns, for values in a user's preset that its sensor does not accept."""
    folders = dict.fromkeys(("preset", "ray_file"), file.path.parent)
    try:
        cls.model_validate({"name": "preset", "mount": {}, **keys}, context=folders)
    except ValidationError as error:
        faults = [fault for fault in faults_of(error, cls) if fault.where and fault.where[0] in own]
        if faults:
            raise file.error([fault.under("sensor") for fault in faults]) from None
