"""`rigcast presets`: rigcast's presets of real devices."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from rigcast.card import Card
from rigcast.card_picture import draw_card, terminal_picture
from rigcast.cli.common.options import JsonFile, console_beside, require_png, say, show, write_json
from rigcast.export.files import replacing
from rigcast.rig_file import sensor_of_preset
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.presets import load_preset, preset_names


def presets(
    name: Annotated[
        str | None,
        typer.Argument(
            help="preset, or a preset file (.yaml), to show",
            show_default=False,
            autocompletion=lambda: list(preset_names()),
        ),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG file for a picture of the card")] = None,
    json_file: JsonFile = None,
) -> None:
    """List the device presets, or show the card of one: its rays, figures, their sources and what is assumed."""
    console = console_beside(json_file)
    if name is None:
        if picture is not None:
            raise InputError("--picture: got no preset, expected the name of one to draw")
        show(console, _list())
    else:
        require_png("--picture", picture)
        _show(Card.of(name), console, picture)
    if json_file is not None:
        shown = preset_names() if name is None else (name,)
        write_json(json_file, json.dumps([_entry(each) for each in shown], indent=1, allow_nan=False) + "\n")


def _show(card: Card, console: Console, picture: Path | None) -> None:
    for line in _lines(card, console):
        say(console, line)
    if picture is not None:
        with replacing(picture) as temporary:
            draw_card(card).save(temporary, format="png")


def _entry(name: str) -> dict[str, Any]:
    """A preset as plain values, including those of the presets it extends."""
    preset = load_preset(name)
    given = {key for each in preset.lineage() for key in each.sensor}
    sensor = json.loads(sensor_of_preset(name).model_dump_json(include=given))  # infinity becomes null
    return {
        "name": preset.name,
        "type": preset.type,
        "description": preset.description,
        "source": [each.source for each in preset.lineage()],
        "assumed": preset.all_assumed(),
        "cited": sorted(preset.cited()),
        "figures": preset.all_figures(),
        "sensor": sensor,
    }


def _list() -> Table:
    table = Table(caption="cited: figures from a source that the card names")
    table.add_column("preset", no_wrap=True)
    table.add_column("type")
    table.add_column("device")
    table.add_column("cited", justify="right", no_wrap=True)
    for preset in map(load_preset, preset_names()):
        cited = f"{len(preset.cited())} of {len(preset.stated())}"
        table.add_row(preset.name, preset.type, preset.description, cited)
    return table


def _lines(card: Card, console: Console) -> list[str]:
    assumed = card.preset.all_assumed()
    drawn = terminal_picture(card) if console.encoding.lower().startswith("utf") else []
    figures = [f"{key}: {value}{' (assumed)' if key in assumed else ''}" for key, value in card.figures()]
    sources = [f"source: {' '.join(preset.source.split())}" for preset in card.preset.lineage()]
    remarks = [f"assumed: {key}: {' '.join(why.split())}" for key, why in assumed.items()]
    return [card.title, f"type: {card.preset.type}", *card.summary(), *drawn, *figures, *sources, *remarks]
