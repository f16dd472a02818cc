"""Rig files: from YAML to a rig on a MuJoCo model, with every mistake shown where it is in the file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Literal

import mujoco

from rigcast.collector import paused_collector
from rigcast.export.options import Export
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.faults import Fault
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.surface import Surface
from rigcast.sensors.yaml.file import YamlFile

from .bindings import binding_faults
from .faults import faults_in, mesh_faults, prop_folder, read_document
from .file import AnySensor
from .layers import read_layers
from .overrides import SOURCE as SET_SOURCE

if TYPE_CHECKING:
    from rigcast.sensors.rig.rig import Rig


@dataclass(frozen=True)
class RigConfig:
    """The contents of a rig file.

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
        """The rig on its compiled model. seed: replaces the file's."""
        from rigcast.sensors.rig.rig import Rig  # imported here, because reading and checking files needs no Warp

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


def read_rig(path: str | Path, overrides: Sequence[str] = ()) -> RigConfig:
    """Read and check a rig file by itself, without its model.

    overrides: each `KEY=VALUE`, such as "sensors.top.rate_hz=5", replacing the file's value.

    Raises InputError with every fault of the file, each as `path:line:col: sensors[0].mount.bdy: what is
    wrong` with the line below it.
    """
    document = read_layers(Path(path), overrides)
    faults = faults_in(document)
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
    faults = faults_in(document)
    faults += mesh_faults(document, faults)
    compiled, model_faults = (given, []) if given is not None else _own_model(document, faults)
    if compiled is not None:
        unbound = binding_faults(document, faults, compiled)
        faults += unbound + _urdf_faults(document, model, unbound)
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
    """The rig of a YAML file, ready for use.

    Args:
        path: the rig file.
        model: an MjModel, or the path of an MJCF, URDF or MJB file, instead of the file's own `model:`.
        device: "cpu", "cuda:0", ...; None takes CUDA if it is present, else "cpu".
        seed: instead of the file's, 0 to 2^63 - 1.
        overrides: values that replace the file's, each `KEY=VALUE` as for `--set`.

    Raises:
        InputError: all mistakes in the file, in those that it extends and in its model, each with its file, line and
            column; or a device that does not exist, or geometry that rays cannot hit.

    >>> rig = load_rig("rig.yaml", overrides=["sensors.top.rate_hz=5"])
    >>> frames = rig.sense(data)
    """
    with paused_collector():
        config, compiled = open_rig(path, model, overrides)
        return config.build(compiled, device, seed)


def compile_model(path: Path) -> mujoco.MjModel:
    """The MuJoCo model in an MJCF, URDF or MJB file. Raises InputError for a missing or faulty one."""
    if not path.is_file():
        raise InputError(f"{path} is not a file, expected a MuJoCo model: MJCF, URDF or MJB")
    if path.suffix in (".yaml", ".yml"):
        raise InputError(f"{path}: a YAML file, expected a MuJoCo model: MJCF, URDF or MJB")
    load = mujoco.MjModel.from_binary_path if path.suffix == ".mjb" else mujoco.MjModel.from_xml_path
    try:
        return load(str(path))
    except (ValueError, mujoco.FatalError) as error:
        reason = "; ".join(str(error).splitlines()).replace(":; ", ": ")
        raise InputError(f"{path} does not compile: {reason}") from None


def _urdf_faults(
    document: YamlFile, model: mujoco.MjModel | str | Path | None, unbound: Sequence[Fault]
) -> list[Fault]:
    """Faults that explain missing bodies: links of a URDF that are not bodies of its model."""
    source = document.content.get("model") if model is None else model
    if not str(source).endswith(".urdf") or not any(fault.message.startswith("no body") for fault in unbound):
        return []
    kept = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    message = f"MuJoCo merges links of a URDF that are fixed to another, and leaves out visuals; within <robot> {kept}"
    return [Fault(("model",) if model is None else (), f"{message} keeps both")]


def _own_model(document: YamlFile, faults: list[Fault]) -> tuple[mujoco.MjModel | None, list[Fault]]:
    """The model that the file names, or its faults besides the known `faults`."""
    if any(fault.where[:1] in ((), ("model",)) for fault in faults):
        return None, []
    name = document.content.get("model")
    if name is None:
        return None, [Fault((), "model: required, as no model was given otherwise")]
    try:
        return compile_model(document.folder(("model",)) / name), []
    except InputError as error:
        return None, [Fault(("model",), str(error))]


def _config(document: YamlFile) -> RigConfig:
    file, _ = read_document(document)
    assert file is not None
    model = None if file.model is None else document.folder(("model",)) / file.model
    props = tuple(
        prop.model_copy(update={"file": prop_folder(document, i) / prop.file}) for i, prop in enumerate(file.props)
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
