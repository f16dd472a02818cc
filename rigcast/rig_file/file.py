"""The keys of a rig file."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from rigcast.export.options import Export
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.spec import Spec
from rigcast.sensors.specs.surface import Surface

AnySensor = Annotated[Lidar | DepthCamera | HeightScan, Field(discriminator="type")]


def _as_names(given: Any) -> Any:
    names = given if isinstance(given, list | tuple) else (given,)
    if given is not None and not all(isinstance(name, str) for name in names):
        raise ValueError(f"must be the name of a file, or a list of them, got {given!r}")
    return tuple(given) if isinstance(given, list) else given


class RigFile(Spec):
    """A rig: the sensors that are mounted on one MuJoCo model."""

    extends: Annotated[str | tuple[str, ...] | None, BeforeValidator(_as_names)] = Field(
        default=None, description="rig file that this one extends, or several; paths relative to this file"
    )
    model: str | None = Field(
        default=None, description="the MuJoCo model, MJCF, URDF or MJB; a path relative to this file"
    )
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of all random numbers")
    keyframe: str | None = Field(default=None, description="name of the keyframe at which a run begins")
    on_unsupported: Literal["error", "warn"] = Field(
        default="error", description="geometry that rays cannot hit yet: refuse the model, or warn and leave it out"
    )
    props: tuple[Prop, ...] = Field(
        default=(), description="meshes that rays hit but that are not in the model; names must be unique"
    )
    surfaces: tuple[Surface, ...] = Field(
        default=(), description="reflectance, instead of the model's colours; the last entry for a thing counts"
    )
    classes: Mapping[str, Sequence[str]] = Field(
        default={},
        description="classes for segmentation: names of geoms, bodies, flexes, skins and props by class; a body "
        "includes everything below it, * and ? match as in a shell",
    )
    export: Export = Field(default=Export(), description="how frames are written")
    sensors: tuple[AnySensor, ...] = Field(
        description="the sensors; names must be unique", json_schema_extra={"minItems": 1}
    )

    @field_validator("sensors")
    @classmethod
    def _some(cls, sensors: tuple[SensorSpec, ...]) -> tuple[SensorSpec, ...]:
        if not sensors:
            raise ValueError("must have at least 1 sensor, got none")
        return sensors
