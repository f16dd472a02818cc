"""The contents of a rig file, and its faults without regard to its model."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import Fault, faults_of
from rigcast.sensors.meshes import read_mesh
from rigcast.sensors.specs.presets import load_preset
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.spec import Spec, is_inside
from rigcast.sensors.yaml.file import YamlFile
from rigcast.sensors.yaml.kinds import other_kind

from .file import AnySensor, RigFile


class _Only(Spec):
    sensors: tuple[AnySensor]


def sensor_of_preset(name: str) -> SensorSpec:
    """A sensor with only the figures of a preset, fixed to the world. Raises InputError."""
    given = {"type": load_preset(name).type, "name": "preset", "mount": {}, "preset": name}
    try:
        return _Only.model_validate({"sensors": [given]}).sensors[0]
    except ValidationError as error:
        raise InputError(f"preset {name!r}: {'; '.join(fault.message for fault in faults_of(error, _Only))}") from None


def faults_in(document: YamlFile) -> list[Fault]:
    """The faults of a rig file, without regard to its model."""
    other = other_kind(document, "rig")
    if other:
        return other
    _, faults = read_document(document)
    return faults + _repeated_names(document.content) + _outside_faults(document, faults)


def read_document(document: YamlFile) -> tuple[RigFile | None, list[Fault]]:
    """The contents of a rig file, or its faults. Sensors are read one by one, because paths need their folders."""
    content, sensors, faults = document.content, [], list[Fault]()
    raws = raw_items("sensors", content)
    for i in range(len(raws)):
        try:
            sensors.append(read_sensor(document, i))
        except ValidationError as error:
            faults += [replace(fault, where=fault.where[2:]).under("sensors", i) for fault in faults_of(error, _Only)]
    try:
        file = RigFile.model_validate({**content, "sensors": sensors} if raws else content)
    except ValidationError as error:
        others = [_with_its_place(fault, content, sensors) for fault in faults_of(error, RigFile)]
        return None, [*(fault for fault in others if not (faults and fault.where == ("sensors",))), *faults]
    return (None if faults else file), faults


def _with_its_place(fault: Fault, content: Any, sensors: Sequence[SensorSpec]) -> Fault:
    """The fault, with a hint if its key of the rig belongs to a sensor, or is the name of a sensor or prop."""
    if not fault.at_key or len(fault.where) != 1:
        return fault
    (key,) = fault.where
    for items in ("sensors", "props"):
        if any(isinstance(item, dict) and item.get("name") == key for item in raw_items(items, content)):
            return replace(fault, message=f"unknown key {key!r}; did you mean '{items}.{key}'?")
    if any(key in type(sensor).model_fields for sensor in sensors):
        return replace(fault, message=f"unknown key {key!r} of a rig, which its sensors have: 'sensors.*.{key}'")
    return fault


def read_sensor(document: YamlFile, index: int) -> AnySensor:
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
    for i, item in enumerate(raw_items(key, content)):
        name = item.get("name") if isinstance(item, dict) else None
        if isinstance(name, str) and first.setdefault(name, i) != i:
            message = f"{name!r} is the name of {key}[{first[name]}] already, expected another"
            faults.append(Fault((key, i, "name"), message))
    return faults


def raw_items(key: str, content: Any) -> Sequence[Any]:
    items = content.get(key) if isinstance(content, dict) else None
    return items if isinstance(items, list) else []


def sound_items(key: str, content: Any, faults: list[Fault]) -> Iterator[tuple[int, Any]]:
    unsound = {fault.where[1] for fault in faults if fault.where[:1] == (key,) and len(fault.where) > 1}
    return ((i, raw) for i, raw in enumerate(raw_items(key, content)) if i not in unsound)


def sound_props(content: Any, faults: list[Fault]) -> Iterator[tuple[int, Prop]]:
    return ((i, Prop.model_validate(raw)) for i, raw in sound_items("props", content, faults))


def _outside_faults(document: YamlFile, faults: list[Fault]) -> list[Fault]:
    """Faults for props outside of the file's folder, which are not allowed."""
    return [
        Fault(
            ("props", i, "file"),
            f"{str(prop.file)!r} is outside of the rig file's folder, expected a file in it or allow_outside: true",
        )
        for i, prop in sound_props(document.content, faults)
        if not prop.allow_outside and not is_inside(prop_folder(document, i), prop.file)
    ]


def prop_folder(document: YamlFile, index: int) -> Path:
    return document.folder(("props", index, "file"))


def mesh_faults(document: YamlFile, faults: list[Fault]) -> list[Fault]:
    """Mesh files of props that cannot be read."""
    broken = []
    for i, prop in sound_props(document.content, faults):
        try:
            read_mesh(prop_folder(document, i) / prop.file)
        except InputError as error:
            broken.append(Fault(("props", i, "file"), str(error)))
    return broken
