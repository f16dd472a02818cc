"""Presets with the figures of real devices: those of `rigcast.configs`, and users' own in YAML files."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError
from ruamel.yaml import YAML

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import faults_of
from rigcast.sensors.names import did_you_mean, listing
from rigcast.sensors.yaml.file import YamlFile, read_yaml
from rigcast.sensors.yaml.kinds import other_kind

from .spec import Spec, is_inside

_SUFFIXES = (".yaml", ".yml")


class PresetFile(Spec):
    """The contents of a preset file."""

    type: str | None = Field(default=None, description="the kind of sensor it is for; null: that of what it extends")
    extends: str | None = Field(default=None, description="a preset whose figures hold where none is given here")
    description: str = Field(description="the device, in one line")
    source: str = Field(description="where the figures were read")
    assumed: dict[str, str] = Field(
        default_factory=dict, description="the figures that are not the maker's, or that no source gives, and why"
    )
    figures: dict[str, Any] = Field(
        default_factory=dict, description="figures of the device for which a sensor has no key, with their units"
    )
    sensor: dict[str, Any] = Field(default_factory=dict, description="values of a sensor's keys")


@dataclass(frozen=True)
class Preset:
    """One device, see `PresetFile`; `type` is always given. file: of a user's preset, None for those of rigcast."""

    name: str
    type: str
    description: str
    source: str
    assumed: Mapping[str, str]
    figures: Mapping[str, Any]
    sensor: Mapping[str, Any]
    base: "Preset | None"
    file: YamlFile | None

    def lineage(self) -> list["Preset"]:
        """This preset, followed by the chain of presets that it extends."""
        return [self, *(self.base.lineage() if self.base else ())]

    def all_figures(self) -> dict[str, Any]:
        """The `figures`, including those of the presets it extends."""
        return {key: value for preset in self.lineage()[::-1] for key, value in preset.figures.items()}

    def all_assumed(self) -> dict[str, str]:
        """The `assumed` keys, including those of the presets it extends that it does not set itself."""
        assumed: dict[str, str] = {}
        for preset in self.lineage()[::-1]:
            renewed = preset.sensor.keys() | preset.figures.keys()
            assumed = {key: why for key, why in assumed.items() if key not in renewed} | dict(preset.assumed)
        return assumed

    def stated(self) -> set[str]:
        """The keys of `sensor` and `figures`, its own and inherited, that are figures of a device."""
        keys = {key for preset in self.lineage() for key in (*preset.sensor, *preset.figures)}
        return keys - {"motion"}  # a switch

    def cited(self) -> set[str]:
        """The keys of `stated` that `source` covers: all that are not assumed."""
        return self.stated() - self.all_assumed().keys()


@cache
def preset_names() -> tuple[str, ...]:
    """The names of rigcast's own presets, sorted."""
    entries = (files("rigcast.configs") / "presets").iterdir()
    return tuple(sorted(entry.name.removesuffix(".yaml") for entry in entries if entry.name.endswith(".yaml")))


def load_preset(name: str, folder: Path | None = None) -> Preset:
    """The preset of this name, or in this file if the name ends in .yaml.

    folder: of the rig file that names it; the file is relative to it and must be in it. None: relative to the working
    directory, anywhere.

    Raises InputError for a name that is not one of `preset_names()`, and for a file that is not a preset.
    """
    if not name.endswith(_SUFFIXES):
        return _load_own(name)
    if folder is not None and not is_inside(folder, Path(name)):
        raise InputError(f"preset {name!r} is outside of the rig file's folder, expected a file in it")
    return _load_file((folder or Path()) / name, ())


@cache
def _load_own(name: str) -> Preset:
    names = preset_names()
    if name not in names:
        raise InputError(
            f"unknown preset {name!r}, expected a .yaml file or one of {listing(names)}{did_you_mean(name, names)}"
        )
    text = (files("rigcast.configs") / "presets" / f"{name}.yaml").read_text(encoding="utf-8")
    content = PresetFile(**YAML(typ="safe", pure=True).load(text))
    return _preset(name, content, None if content.extends is None else _load_own(content.extends), None)


def _load_file(path: Path, extending: tuple[Path, ...]) -> Preset:
    """A user's own preset. extending: the files that extend it, directly or not."""
    if path.resolve() in extending:
        raise InputError(f"{path}: extends itself")
    document = read_yaml(path)
    other = other_kind(document, "preset")
    if other:
        raise document.error(other)
    try:
        content = PresetFile.model_validate(document.content)
    except ValidationError as error:
        raise document.error(faults_of(error, PresetFile)) from None
    base = None
    if content.extends is not None and content.extends.endswith(_SUFFIXES):
        if not is_inside(path.parent, Path(content.extends)):
            raise InputError(f"{path}: extends {content.extends!r}, expected a file in the same folder")
        base = _load_file(path.parent / content.extends, (*extending, path.resolve()))
    elif content.extends is not None:
        base = _load_own(content.extends)
    if base is None and content.type is None:
        raise InputError(f"{path}: expected type or extends, got neither")
    return _preset(path.stem, content, base, document)


def _preset(name: str, content: PresetFile, base: Preset | None, document: YamlFile | None) -> Preset:
    kind = content.type or (base.type if base else "")
    sensor = content.sensor if document is None else _resolved(content.sensor, document.path.parent)
    return Preset(
        name, kind, content.description, content.source, content.assumed, content.figures, sensor, base, document
    )


def _resolved(sensor: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The keys of a user's preset, with file names resolved against the preset's folder."""
    rays = sensor.get("ray_file")
    if not (isinstance(rays, dict) and isinstance(rays.get("path"), str)):
        return dict(sensor)
    return {**sensor, "ray_file": {**rays, "path": str(folder.resolve() / rays["path"])}}
