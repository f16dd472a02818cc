"""Kinds of YAML files, told apart by keys that only one has, to name the command for a file of another kind."""

from typing import Literal

from rigcast.sensors.faults import Fault

from .file import YamlFile

Kind = Literal["rig", "data set", "preset"]

_KEYS: dict[Kind, set[str]] = {
    "rig": {"model", "sensors"},
    "data set": {"scenes", "episodes"},
    "preset": {"description", "source"},
}
_COMMANDS: dict[Kind, str] = {
    "rig": "`rigcast validate {path}` shows it",
    "data set": "`rigcast dataset {path}` makes it",
    "preset": "`rigcast presets {path}` shows it, and a sensor of a rig names it: `preset: {path.name}`",
}


def other_kind(document: YamlFile, expected: Kind) -> list[Fault]:
    """The fault of a file that has keys of another kind, and none of the expected one."""
    if not isinstance(document.content, dict):
        return []
    has = [kind for kind, keys in _KEYS.items() if keys & document.content.keys()]
    if expected in has or len(has) != 1:
        return []
    command = _COMMANDS[has[0]].format(path=document.path)
    return [Fault((), f"a {has[0]}, expected a {expected}; {command}")]
