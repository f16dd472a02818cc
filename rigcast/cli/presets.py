"""`rigcast presets`: the devices whose figures rigcast brings along."""

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.table import Table

from rigcast.cli.options import JsonFile, console_beside, write_json
from rigcast.sensors.specs.presets import load_preset, preset_names


def presets(
    name: Annotated[
        str | None,
        typer.Argument(help="show this one's figures", show_default=False, autocompletion=lambda: list(preset_names())),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """List the device presets, or show one: its figures, where they are from, which are assumed."""
    console = console_beside(json_file)
    if name is None:
        console.print(_list())
    else:
        for line in _lines(name):
            console.print(line, markup=False)
    if json_file is not None:
        shown = preset_names() if name is None else (name,)
        write_json(json_file, json.dumps([asdict(load_preset(each)) for each in shown], indent=1) + "\n")


def _list() -> Table:
    table = Table("preset", "type", "device")
    for preset in map(load_preset, preset_names()):
        table.add_row(preset.name, preset.type, preset.description)
    return table


def _lines(name: str) -> list[str]:
    preset = load_preset(name)
    figures = [f"{key}: {value}" for key, value in preset.sensor.items()]
    remarks = [f"assumed: {remark}" for remark in preset.assumed]
    heading = [f"{preset.name}: {preset.description}", f"type: {preset.type}"]
    return [*heading, *figures, f"source: {preset.source}", *remarks]
