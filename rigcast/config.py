"""Rig files: from YAML to a rig on a MuJoCo model, with every mistake shown where it is in the file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, Literal

import mujoco
from pydantic import ValidationError

from rigcast.export.ids import class_faults
from rigcast.export.options import Export
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.faults import Fault, faults_of
from rigcast.sensors.names import expected_one_of, model_names
from rigcast.sensors.scene.mesh_file import read_mesh
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.presets import load_preset
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.spec import Spec, is_inside
from rigcast.sensors.specs.surface import Surface
from rigcast.sensors.yaml_positions import YamlFile

from .rig_file import AnySensor, RigFile
from .yaml_layers import read_layers
from .yaml_set import SOURCE as SET_SOURCE

if TYPE_CHECKING:
    from rigcast.sensors.rig.rig import Rig

_PARTS: dict[str, type[Mount | Filter]] = {"mount": Mount, "filter": Filter}


class _Only(Spec):
    sensors: tuple[AnySensor]


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
    surfaces: tuple[Surface, ...]
    classes: Mapping[str, Sequence[str]]
    export: Export
    sensors: tuple[AnySensor, ...]

    def build(self, model: mujoco.MjModel, device: str | None = None, seed: int | None = None) -> "Rig":
        """The rig on its compiled model. seed: in place of the file's."""
        from rigcast.sensors.rig.rig import Rig  # here, as reading and checking files needs no Warp

        own_seed = self.seed if seed is None else seed
        return Rig(
            model,
            self.sensors,
            device,
            own_seed,
            props=self.props,
            surfaces=self.surfaces,
            on_unsupported=self.on_unsupported,
        )


def sensor_of_preset(name: str) -> SensorSpec:
    """A sensor, fixed to the world, that has the figures of a preset and no others. Raises InputError."""
    given = {"type": load_preset(name).type, "name": "preset", "mount": {}, "preset": name}
    try:
        return _Only.model_validate({"sensors": [given]}).sensors[0]
    except ValidationError as error:
        faults = (f"preset {name!r}: {'; '.join(one['msg'] for one in error.errors())}",)
        raise InputError("\n".join(faults)) from None


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
    require_type("rig file", path, str, Path)
    require_type("model", model, mujoco.MjModel, str, Path, NoneType)
    given = compile_model(Path(model)) if isinstance(model, str | Path) else model
    document = read_layers(Path(path), overrides)
    faults = _faults(document)
    faults += _mesh_faults(document, faults)
    compiled, model_faults = (given, []) if given is not None else _own_model(document, faults)
    if compiled is not None:
        faults += _binding_faults(document, faults, compiled)
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

    Args:
        path: of the rig file.
        model: an MjModel, or the path of one, in place of the file's own `model:`.
        device: "cpu", "cuda:0", ...; None picks CUDA if present.
        seed: in place of the file's.
        overrides: values in place of the file's, each as `--set` takes it.

    Raises:
        InputError: every mistake in the file and in its model, each with its place in the file.

    >>> rig = load_rig("rig.yaml", overrides=["sensors.top.rate_hz=5"])
    >>> frames = rig.sense(data)
    """
    config, compiled = open_rig(path, model, overrides)
    return config.build(compiled, device, seed)


def compile_model(path: Path) -> mujoco.MjModel:
    """The MuJoCo model in an MJCF, URDF or MJB file. Raises InputError for a missing or faulty one."""
    if not path.is_file():
        raise InputError(f"{path} is not a file, expected a MuJoCo model: MJCF, URDF or MJB")
    load = mujoco.MjModel.from_binary_path if path.suffix == ".mjb" else mujoco.MjModel.from_xml_path
    try:
        return load(str(path))
    except (ValueError, mujoco.FatalError) as error:
        reason = "; ".join(str(error).splitlines())
        raise InputError(f"{path} does not compile: {reason}") from None


def _faults(document: YamlFile) -> list[Fault]:
    """What is wrong with a rig file in itself."""
    _, faults = _read(document)
    return faults + _repeated_names(document.content) + _outside_faults(document, faults)


def _read(document: YamlFile) -> tuple[RigFile | None, list[Fault]]:
    """What a rig file says, or what is wrong with it. Sensors are read one by one, as paths need their folders."""
    content, sensors, faults = document.content, [], list[Fault]()
    raws = _raw_items("sensors", content)
    for i in range(len(raws)):
        try:
            sensors.append(_sensor(document, i))
        except ValidationError as error:
            faults += [replace(fault, where=fault.where[2:]).under("sensors", i) for fault in faults_of(error, _Only)]
    try:
        file = RigFile.model_validate({**content, "sensors": sensors} if raws else content)
    except ValidationError as error:
        others = faults_of(error, RigFile)
        return None, [*(fault for fault in others if not (faults and fault.where == ("sensors",))), *faults]
    return (None if faults else file), faults


def _sensor(document: YamlFile, index: int) -> AnySensor:
    raw, at = document.content["sensors"][index], ("sensors", index)
    own_rays = isinstance(raw, dict) and "ray_file" in raw
    preset = document.folder((*at, "preset"))
    folders = {"preset": preset, "ray_file": document.folder((*at, "ray_file", "path")) if own_rays else preset}
    return _Only.model_validate({"sensors": [raw]}, context=folders).sensors[0]


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


def _binding_faults(document: YamlFile, faults: list[Fault], model: mujoco.MjModel) -> list[Fault]:
    """What the model lacks, for the sensors and props that have no `faults` in themselves."""
    content = document.content
    unbound = _keyframe_faults(content, model) + _class_faults(content, faults, model)
    for i, _ in _sound_items("sensors", content, faults):
        unbound += [fault.under("sensors", i) for fault in _sensor(document, i).faults(model)]
    unbound += _part_faults(content, faults, model)
    for i, raw in _sound_items("props", content, faults):
        unbound += [fault.under("props", i) for fault in Prop.model_validate(raw).faults(model)]
    props = [str(raw.get("name")) for raw in _raw_items("props", content) if isinstance(raw, dict)]
    for i, raw in _sound_items("surfaces", content, faults):
        unbound += [fault.under("surfaces", i) for fault in Surface.model_validate(raw).faults(model, props)]
    return unbound


def _part_faults(content: Any, faults: list[Fault], model: mujoco.MjModel) -> list[Fault]:
    """The same for mounts and filters without `faults` in sensors that have some."""
    sound = {i for i, _ in _sound_items("sensors", content, faults)}
    known = {fault.where[:3] for fault in faults}
    unbound = []
    for i, raw in enumerate(_raw_items("sensors", content)):
        for key, spec in _PARTS.items():
            if i not in sound and isinstance(raw, dict) and key in raw and ("sensors", i, key) not in known:
                unbound += [fault.under("sensors", i, key) for fault in _faults_of_part(raw[key], spec, model)]
    return unbound


def _faults_of_part(raw: Any, spec: type[Mount | Filter], model: mujoco.MjModel) -> list[Fault]:
    try:
        return spec.model_validate(raw).faults(model)
    except ValidationError as error:
        return faults_of(error, spec)


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
        if not prop.allow_outside and not is_inside(_prop_folder(document, i), prop.file)
    ]


def _prop_folder(document: YamlFile, index: int) -> Path:
    return document.folder(("props", index, "file"))


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


def _class_faults(content: Any, faults: list[Fault], model: mujoco.MjModel) -> list[Fault]:
    classes = content.get("classes") if isinstance(content, dict) else None
    if classes is None or any(fault.where[:1] == ("classes",) for fault in faults):
        return []
    props = [Prop.model_validate(raw) for _, raw in _sound_items("props", content, faults)]
    return [fault.under("classes") for fault in class_faults(model, classes, props)]


def _config(document: YamlFile) -> RigConfig:
    file, _ = _read(document)
    assert file is not None
    model = None if file.model is None else document.folder(("model",)) / file.model
    props = tuple(
        prop.model_copy(update={"file": _prop_folder(document, i) / prop.file}) for i, prop in enumerate(file.props)
    )
    return RigConfig(
        path=document.path,
        files=tuple(Path(source) for source in document.texts if source != SET_SOURCE),
        model=model,
        seed=file.seed,
        keyframe=file.keyframe,
        on_unsupported=file.on_unsupported,
        props=props,
        surfaces=file.surfaces,
        classes=file.classes,
        export=file.export,
        sensors=file.sensors,
    )
