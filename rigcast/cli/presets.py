"""`rigcast presets`: the devices whose figures rigcast brings along."""

from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from rigcast.sensors.specs.presets import load_preset, preset_names


def presets(
    name: Annotated[str | None, typer.Argument(help="show this one's figures", show_default=False)] = None,
) -> None:
    """List the device presets, or show one: its figures, where they are from, which are assumed."""
    console = Console(highlight=False)
    if name is None:
        console.print(_list())
    else:
        for line in _lines(name):
            console.print(line, markup=False)


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
