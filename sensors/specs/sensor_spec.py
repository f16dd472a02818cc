"""What every sensor has: a name, a mount, what it may hit, how often and how far it measures."""

import math
from abc import abstractmethod
from typing import Any, ClassVar, cast

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic.config import JsonDict

from rigcast.sensors.faults import Fault

from .filter import Filter
from .mount import Mount
from .pattern import Pattern
from .presets import load_preset, preset_names
from .spec import Spec


def no_default(schema: JsonDict) -> None:
    """Leave a default out of the JSON schema: JSON has no infinity, and no sign for "from the preset"."""
    schema.pop("default", None)


def _list_presets(schema: JsonDict) -> None:
    schema["examples"] = list(preset_names())


def _require_type(schema: JsonDict) -> None:
    # In Python the class says it; in a file nothing else would.
    schema["required"] = ["type", *cast("list[str]", schema["required"])]


class SensorSpec(Spec):
    """The base of all sensors.

    frame_rotation: (3, 3), the axes of the sensor's frame as columns in the mount's. The sensor's pose is the
        mount's times this, and `Pattern.directions` are in the frame that results.
    yaw_aligned: whether the sensor's frame keeps only position and yaw of the mount, its z upright.
    """

    model_config = ConfigDict(json_schema_extra=_require_type)

    frame_rotation: ClassVar[NDArray[np.float64]] = np.eye(3)
    yaw_aligned: ClassVar[bool] = False
    # Sets of keys that say the same in different ways: giving one drops the preset's others.
    _alternatives: ClassVar[tuple[frozenset[str], ...]] = ()

    type: str
    name: str = Field(
        pattern=r"^[A-Za-z0-9_-]{1,64}$",
        description="unique in the rig; letters, digits, _ and -, as it names a folder and topics",
    )
    preset: str | None = Field(
        default=None,
        description="a device whose figures hold where no other key is given",
        json_schema_extra=_list_presets,
    )
    mount: Mount = Field(description="where the sensor is")
    filter: Filter = Field(default=Filter(), description="which geoms its rays may hit")
    rate_hz: float | None = Field(default=None, gt=0, description="readings per second [Hz]; null: every step")
    min_range: float = Field(default=0.0, ge=0, description="nearer hits read as -inf [m]")
    max_range: float = Field(
        default=math.inf,
        gt=0,
        allow_inf_nan=True,
        description="farther hits read as +inf [m]; unlimited if not given",
        json_schema_extra=no_default,
    )

    @abstractmethod
    def pattern(self, model: mujoco.MjModel) -> Pattern:
        """The rays of one reading, for a sensor mounted on `model`."""

    def faults(self, model: mujoco.MjModel) -> list[Fault]:
        """What keeps this sensor from being mounted on `model`, each as a place in this specification."""
        mount = [fault.under("mount") for fault in self.mount.faults(model)]
        return mount + [fault.under("filter") for fault in self.filter.faults(model)]

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any) -> Any:
        if not isinstance(given, dict) or given.get("preset") not in preset_names():
            return given
        preset = load_preset(given["preset"])
        if preset.type != _type_of(cls):
            return given
        return {**{key: preset.sensor[key] for key in preset.sensor.keys() - cls._replaced(given)}, **given}

    @classmethod
    def _replaced(cls, given: dict[str, Any]) -> set[str]:
        """Keys of which a preset's values must not be mixed with the `given` ones."""
        chosen = [group for group in cls._alternatives if group & given.keys()]
        return {key for group in cls._alternatives if chosen and group not in chosen for key in group}

    @field_validator("preset")
    @classmethod
    def _known_preset(cls, name: str | None) -> str | None:
        if name is None:
            return None
        preset, own = load_preset(name), _type_of(cls)
        if preset.type != own:
            fitting = [other for other in preset_names() if load_preset(other).type == own]
            raise ValueError(f"{name!r} is a {preset.type}, expected a {own}: {', '.join(fitting) or 'there is none'}")
        return name

    @field_validator("max_range")
    @classmethod
    def _above_minimum(cls, max_range: float, info: ValidationInfo) -> float:
        min_range = info.data.get("min_range", 0.0)
        if max_range <= min_range:
            raise ValueError(f"must be above min_range, {min_range:g} m, got {max_range:g} m")
        return max_range


def _type_of(cls: type[SensorSpec]) -> str:
    return str(cls.model_fields["type"].default)
