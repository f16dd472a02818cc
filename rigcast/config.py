"""Rig files: from YAML to a rig on a MuJoCo model, with every mistake shown where it is in the file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import mujoco
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError, field_validator

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import Fault, faults_of
from rigcast.sensors.names import expected_one_of, model_names
from rigcast.sensors.scene.mesh_file import read_mesh
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidar import Lidar
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.spec import Spec

from .yaml_layers import read_layers
from .yaml_positions import YamlFile
from .yaml_set import SOURCE as SET_SOURCE

if TYPE_CHECKING:
    from rigcast.sensors.rig.rig import Rig

AnySensor = Annotated[Lidar | DepthCamera | HeightScan, Field(discriminator="type")]
_SENSOR: TypeAdapter[AnySensor] = TypeAdapter(AnySensor)


def _as_names(given: Any) -> Any:
    names = given if isinstance(given, list | tuple) else (given,)
    if given is not None and not all(isinstance(name, str) for name in names):
        raise ValueError(f"must be the name of a file, or a list of them, got {given!r}")
    return tuple(given) if isinstance(given, list) else given


class RigFile(Spec):
    """A rig: the sensors that are mounted on one MuJoCo model."""

    extends: Annotated[str | tuple[str, ...] | None, BeforeValidator(_as_names)] = Field(
        default=None, description="another rig file that this one is laid over, or several; paths relative to this file"
    )
    model: str | None = Field(
        default=None, description="the MuJoCo model, MJCF, URDF or MJB; a path relative to this file"
    )
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of all random numbers")
    keyframe: str | None = Field(default=None, description="name of the keyframe at which a run begins")
    on_unsupported: Literal["error", "warn"] = Field(
        default="error", description="what to do about geometry that rays cannot hit: refuse it, or leave it out"
    )
    props: tuple[Prop, ...] = Field(
        default=(), description="meshes that rays hit and the model does not have, each with a name of its own"
    )
    sensors: tuple[AnySensor, ...] = Field(
        description="the sensors, each with a name of its own", json_schema_extra={"minItems": 1}
    )

    @field_validator("sensors")
    @classmethod
    def _some(cls, sensors: tuple[SensorSpec, ...]) -> tuple[SensorSpec, ...]:
        if not sensors:
            raise ValueError("must have at least 1 sensor, got none")
        return sensors


@dataclass(frozen=True)
class RigConfig:
    """What a rig file says.

    `model` and the files of props are resolved against the folder of the file that names them; `model` is None where
    none is named. files: all that were read, `path` first.
    """

    path: Path
    files: tuple[Path, ...]
    model: Path | None
    seed: int
    keyframe: str | None
    on_unsupported: Literal["error", "warn"]
    props: tuple[Prop, ...]
    sensors: tuple[AnySensor, ...]

    def build(self, model: mujoco.MjModel, device: str | None = None, seed: int | None = None) -> "Rig":
        """The rig on its compiled model. seed: in place of the file's."""
        from rigcast.sensors.rig.rig import Rig  # here, as reading and checking files needs no Warp

        own_seed = self.seed if seed is None else seed
        return Rig(model, self.sensors, device, own_seed, props=self.props, on_unsupported=self.on_unsupported)


def read_rig(path: str | Path, overrides: Sequence[str] = ()) -> RigConfig:
    """Read and check a rig file by itself, without its model.

    overrides: each `KEY=VALUE`, such as "sensors.top.rate_hz=5", in place of what the file says.

    Raises InputError with every fault of the file, each as `path:line:col: sensors[0].mount.bdy: what is
    wrong` with the line below it.
    """
    document = read_layers(Path(path), overrides)
    faults = _faults(document)
    if faults:
        raise document.error(faults)
    return _config(document)


def open_rig(
    path: str | Path, model: mujoco.MjModel | str | Path | None = None, overrides: Sequence[str] = ()
) -> tuple[RigConfig, mujoco.MjModel]:
    """Read a rig file, compile its model (or take `model` instead) and check one against the other.

    Raises InputError with every fault of the file, as `read_rig` does, among them the names that the model
    does not have, even where other parts of the file are at fault.
    """
    given = compile_model(Path(model)) if isinstance(model, str | Path) else model
    document = read_layers(Path(path), overrides)
    faults = _faults(document)
    faults += _mesh_faults(document, faults)
    compiled, model_faults = (given, []) if given is not None else _own_model(document, faults)
    if compiled is not None:
        faults += _binding_faults(document.content, faults, compiled)
    if compiled is None or faults:
        raise document.error(faults + model_faults)
    return _config(document), compiled


def load_rig(
    path: str | Path,
    model: mujoco.MjModel | str | Path | None = None,
    device: str | None = None,
    seed: int | None = None,
    *,
    overrides: Sequence[str] = (),
) -> "Rig":
    """The rig of a YAML file, ready to sense.

    model: an MjModel, or the path of one, in place of the file's own `model:`. device: "cpu", "cuda:0", ...;
    None picks CUDA if present. seed: in place of the file's. overrides: values in place of the file's, as
    `--set` takes them. Raises InputError as `open_rig` does.

    >>> rig = load_rig("rig.yaml", overrides=["sensors.top.rate_hz=5"])
    >>> frames = rig.sense(data)
    """
    config, compiled = open_rig(path, model, overrides)
    return config.build(compiled, device, seed)


def compile_model(path: Path) -> mujoco.MjModel:
    """The MuJoCo model in an MJCF, URDF or MJB file. Raises InputError for a missing or faulty one."""
    if not path.is_file():
        raise InputError(f"model {path} is not a file")
    load = mujoco.MjModel.from_binary_path if path.suffix == ".mjb" else mujoco.MjModel.from_xml_path
    try:
        return load(str(path))
    except (ValueError, mujoco.FatalError) as error:
        reason = "; ".join(str(error).splitlines())
        raise InputError(f"model {path} does not compile: {reason}") from None


def _faults(document: YamlFile) -> list[Fault]:
    """What is wrong with a rig file in itself."""
    try:
        RigFile.model_validate(document.content)
        faults = []
    except ValidationError as error:
        faults = faults_of(error, RigFile)
    return faults + _repeated_names(document.content) + _outside_faults(document, faults)


def _repeated_names(content: Any) -> list[Fault]:
    return [fault for key in ("props", "sensors") for fault in _repeated_in(key, content)]


def _repeated_in(key: str, content: Any) -> list[Fault]:
    first: dict[str, int] = {}
    faults = []
    for i, item in enumerate(_raw_items(key, content)):
        name = item.get("name") if isinstance(item, dict) else None
        if isinstance(name, str) and first.setdefault(name, i) != i:
            message = f"{name!r} is the name of {key}[{first[name]}] already, expected another"
            faults.append(Fault((key, i, "name"), message))
    return faults


def _raw_items(key: str, content: Any) -> Sequence[Any]:
    items = content.get(key) if isinstance(content, dict) else None
    return items if isinstance(items, list) else []


def _own_model(document: YamlFile, faults: list[Fault]) -> tuple[mujoco.MjModel | None, list[Fault]]:
    """The model that the file names, or what is wrong with it beyond the known `faults`."""
    if any(fault.where[:1] in ((), ("model",)) for fault in faults):
        return None, []
    name = document.content.get("model")
    if name is None:
        return None, [Fault((), "model: required, as no model was given otherwise")]
    try:
        return compile_model(document.folder(("model",)) / name), []
    except InputError as error:
        return None, [Fault(("model",), str(error))]


def _binding_faults(content: Any, faults: list[Fault], model: mujoco.MjModel) -> list[Fault]:
    """What the model lacks, for the sensors and props that have no `faults` in themselves."""
    unbound = _keyframe_faults(content, model)
    for i, raw in _sound_items("sensors", content, faults):
        unbound += [fault.under("sensors", i) for fault in _SENSOR.validate_python(raw).faults(model)]
    for i, raw in _sound_items("props", content, faults):
        unbound += [fault.under("props", i) for fault in Prop.model_validate(raw).faults(model)]
    return unbound


def _sound_items(key: str, content: Any, faults: list[Fault]) -> Iterator[tuple[int, Any]]:
    unsound = {fault.where[1] for fault in faults if fault.where[:1] == (key,) and len(fault.where) > 1}
    return ((i, raw) for i, raw in enumerate(_raw_items(key, content)) if i not in unsound)


def _outside_faults(document: YamlFile, faults: list[Fault]) -> list[Fault]:
    """Props outside of the file's folder that may not be there."""
    props = [(i, Prop.model_validate(raw)) for i, raw in _sound_items("props", document.content, faults)]
    return [
        Fault(
            ("props", i, "file"),
            f"{str(prop.file)!r} is outside of the rig file's folder, expected a file in it or allow_outside: true",
        )
        for i, prop in props
        if not prop.allow_outside and not _is_inside(_prop_folder(document, i), prop.file)
    ]


def _prop_folder(document: YamlFile, index: int) -> Path:
    return document.folder(("props", index, "file"))


def _is_inside(folder: Path, file: Path) -> bool:
    """Whether a file is in a folder once all links are followed."""
    try:
        return (folder / file).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # links in a circle, a zero byte
        return False


def _mesh_faults(document: YamlFile, faults: list[Fault]) -> list[Fault]:
    """Mesh files of props that cannot be read."""
    broken = []
    for i, raw in _sound_items("props", document.content, faults):
        try:
            read_mesh(_prop_folder(document, i) / Prop.model_validate(raw).file)
        except InputError as error:
            broken.append(Fault(("props", i, "file"), str(error)))
    return broken


def _keyframe_faults(content: Any, model: mujoco.MjModel) -> list[Fault]:
    name = content.get("keyframe") if isinstance(content, dict) else None
    if not isinstance(name, str) or mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, name) >= 0:
        return []
    names = model_names(model, mujoco.mjtObj.mjOBJ_KEY, model.nkey)
    return [Fault(("keyframe",), f"no keyframe {name!r} in the model, {expected_one_of(name, names)}")]


def _config(document: YamlFile) -> RigConfig:
    file = RigFile.model_validate(document.content)
    model = None if file.model is None else document.folder(("model",)) / file.model
    props = tuple(
        prop.model_copy(update={"file": _prop_folder(document, i) / prop.file}) for i, prop in enumerate(file.props)
    )
    files = tuple(Path(source) for source in document.texts if source != SET_SOURCE)
    return RigConfig(document.path, files, model, file.seed, file.keyframe, file.on_unsupported, props, file.sensors)
