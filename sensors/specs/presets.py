"""The figures of real devices, from `rigcast.configs`."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from ruamel.yaml import YAML

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of


@dataclass(frozen=True)
class Preset:
    """One device: the keys of its specification, and where each figure is from.

    type: the kind of sensor it is for. sensor: values by key. source: where they were read. assumed: the ones
    that are not the maker's, or were not found in a source of the maker, one remark each.
    """

    name: str
    type: str
    description: str
    source: str
    assumed: tuple[str, ...]
    sensor: Mapping[str, Any]


@cache
def preset_names() -> tuple[str, ...]:
    """The names of all presets, sorted."""
    entries = (files("rigcast.configs") / "presets").iterdir()
    return tuple(sorted(entry.name.removesuffix(".yaml") for entry in entries if entry.name.endswith(".yaml")))


@cache
def load_preset(name: str) -> Preset:
    """The preset of that name. Raises InputError for a name that is not one of `preset_names()`."""
    if name not in preset_names():
        raise InputError(f"unknown preset {name!r}, {expected_one_of(name, preset_names())}")
    text = (files("rigcast.configs") / "presets" / f"{name}.yaml").read_text(encoding="utf-8")
    content = YAML(typ="safe", pure=True).load(text)
    return Preset(name=name, **{**content, "assumed": tuple(content["assumed"])})
