"""Names in a rig file that its model does not have."""

from typing import Any

import mujoco
from pydantic import ValidationError

from rigcast.export.ids import class_faults
from rigcast.sensors.faults import Fault, faults_of
from rigcast.sensors.names import expected_one_of, model_names
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.surface import Surface
from rigcast.sensors.yaml.file import YamlFile

from .faults import raw_items, read_sensor, sound_items, sound_props

_PARTS: dict[str, type[Mount | Filter]] = {"mount": Mount, "filter": Filter}


def binding_faults(document: YamlFile, faults: list[Fault], model: mujoco.MjModel) -> list[Fault]:
    """Names that the model does not have, in sensors and props without `faults` of their own."""
    content = document.content
    unbound = _keyframe_faults(content, model) + _class_faults(content, faults, model)
    for i, _ in sound_items("sensors", content, faults):
        unbound += [fault.under("sensors", i) for fault in read_sensor(document, i).faults(model)]
    unbound += _part_faults(content, faults, model)
    for i, prop in sound_props(content, faults):
        unbound += [fault.under("props", i) for fault in prop.faults(model)]
    props = [str(raw.get("name")) for raw in raw_items("props", content) if isinstance(raw, dict)]
    for i, raw in sound_items("surfaces", content, faults):
        unbound += [fault.under("surfaces", i) for fault in Surface.model_validate(raw).faults(model, props)]
    return unbound


def _part_faults(content: Any, faults: list[Fault], model: mujoco.MjModel) -> list[Fault]:
    """Names that the model does not have, in sound mounts and filters of sensors with `faults`."""
    sound = {i for i, _ in sound_items("sensors", content, faults)}
    known = {fault.where[:3] for fault in faults}
    unbound = []
    for i, raw in enumerate(raw_items("sensors", content)):
        for key, spec in _PARTS.items():
            if i not in sound and isinstance(raw, dict) and key in raw and ("sensors", i, key) not in known:
                unbound += [fault.under("sensors", i, key) for fault in _faults_of_part(raw[key], spec, model)]
    return unbound


def _faults_of_part(raw: Any, spec: type[Mount | Filter], model: mujoco.MjModel) -> list[Fault]:
    try:
        return spec.model_validate(raw).faults(model)
    except ValidationError as error:
        return faults_of(error, spec)


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
    props = [prop for _, prop in sound_props(content, faults)]
    return [fault.under("classes") for fault in class_faults(model, classes, props)]
