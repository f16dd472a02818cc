"""The keys of a data set's file."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from rigcast.export.fields import FIELD_NAMES
from rigcast.sensors.specs.spec import Spec

Name = Annotated[str, Field(pattern="^[A-Za-z0-9_-]+$", max_length=64)]
FunctionName = Annotated[str, Field(pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$")]


class SceneSource(Spec):
    """Where the model of an episode comes from: a file, or a function that makes one from the episode's seed."""

    name: Name = Field(description="name of the scene, of its shards' folder")
    file: str | None = Field(default=None, description="MJCF, URDF or MJB; a path relative to this file")
    python: FunctionName | None = Field(
        default=None,
        description="module:function, called with the episode's seed, returns an MjModel; the module may be beside "
        "this file",
    )

    @model_validator(mode="after")
    def _one_source(self) -> "SceneSource":
        if (self.file is None) == (self.python is None):
            raise ValueError(f"give one of file and python, got {'none' if self.file is None else 'both'}")
        return self


class Passive(Spec):
    """Physics without a controller: `ctrl` stays as in the rig's keyframe."""

    type: Literal["passive"] = "passive"


class RandomActions(Spec):
    """Random values for every actuator within its `ctrlrange`, or within -1 to 1 if it has none."""

    type: Literal["random"]
    hold: float = Field(default=0.1, gt=0, description="time for which an action is held [s]")


class RecordedMotion(Spec):
    """Recorded positions played back without physics; between two rows joints move at constant speed."""

    type: Literal["recorded"]
    file: str = Field(description="NPY file of (rows, nq) numbers, a qpos in each row; a path relative to this file")
    rate_hz: float = Field(gt=0, description="rows per second [Hz]")


class UserController(Spec):
    """A controller of the user's own."""

    type: Literal["python"]
    function: FunctionName = Field(
        description="module:function, called once with the MjModel and the episode's seed, returns a function that is "
        "called with the MjData before every step and writes its ctrl"
    )


Controller = Annotated[
    Passive | RandomActions | RecordedMotion | UserController, Field(discriminator="type", title="Controller")
]


class Episodes(Spec):
    """How often each scene is run, for how long, and with which controller."""

    count: int = Field(ge=1, le=10**8, description="episodes of each scene")
    duration: float = Field(gt=0, description="simulated time of an episode [s]")
    controller: Controller = Field(default=Passive(), description="what moves the robot")


class PoseRange(Spec):
    """How far a body may be from where the model, the rig's keyframe or a recorded motion puts it."""

    pos: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="largest displacement either way along its parent's x, y and z [m]"
    )
    euler_deg: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="largest rotation either way about its parent's fixed x, y and z [deg]"
    )


class Randomise(Spec):
    """What differs from one episode to the next, uniformly distributed, by the episode's seed."""

    poses: Mapping[str, PoseRange] = Field(default={}, description="for each body name, how far the body may be moved")
    rig: Mapping[str, Sequence[float]] = Field(
        default={},
        description="for any number in the rig, by its key as in --set, the range [low, high] from which it is drawn: "
        "sensors.top.noise.range_std, sensors.*.weather.rain_rate, surfaces[0].reflectivity",
    )

    @field_validator("rig")
    @classmethod
    def _ranges(cls, ranges: Mapping[str, Sequence[float]]) -> Mapping[str, Sequence[float]]:
        for key, numbers in ranges.items():
            if len(numbers) != 2 or numbers[0] > numbers[1]:
                raise ValueError(f"{key}: must be [low, high], got {list(numbers)}")
        return ranges


class Output(Spec):
    """How shards are written."""

    format: Literal["npz", "zarr"] = Field(
        default="npz", description="npz: uncompressed, fastest to read; zarr: compressed, needs the extra zarr"
    )
    exr: bool = Field(default=False, description="write the frames of depth cameras as EXR too")
    fields: Mapping[str, Sequence[str]] = Field(
        default={},
        description="for each sensor name, the fields of its frames that are written besides time and pose; sensors "
        "not named here write all fields",
        json_schema_extra={"additionalProperties": {"type": "array", "items": {"enum": list(FIELD_NAMES)}}},
    )


class DatasetFile(Spec):
    """A data set: a rig, its scenes and episodes."""

    rig: str = Field(description="the rig, a YAML file; a path relative to this file")
    scenes: tuple[SceneSource, ...] = Field(
        description="the models that the rig is mounted on, instead of the rig's own",
        json_schema_extra={"minItems": 1},
    )
    episodes: Episodes = Field(description="what happens in each scene")
    randomise: Randomise = Field(default=Randomise(), description="what differs from one episode to the next")
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of all random numbers, instead of the rig's own")
    output: Output = Field(default=Output(), description="how shards are written")
    portable: bool = Field(
        default=False,
        description="compile for any CPU of the architecture, not for the one at hand, so that all machines of a mixed "
        "cluster run the same code",
    )

    @field_validator("scenes")
    @classmethod
    def _some(cls, scenes: tuple[SceneSource, ...]) -> tuple[SceneSource, ...]:
        if not scenes:
            raise ValueError("must have at least 1 scene, got none")
        return scenes
