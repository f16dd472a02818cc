"""`rigcast presets`: the devices whose figures rigcast brings along."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from rigcast.card import Card
from rigcast.export.files import replacing
from rigcast.preview.card import draw_card, terminal_picture
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.presets import load_preset, preset_names


def presets(
    name: Annotated[str | None, typer.Argument(help="show its card; or a file .yaml", show_default=False)] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG file to draw the card to")] = None,
) -> None:
    """List the device presets, or show the card of one: its rays, figures, where they are from, which are assumed."""
    console = Console(highlight=False)
    if name is None:
        if picture is not None:
            raise InputError("--picture: needs the name of a preset")
        console.print(_list())
        return
    card = Card.of(name)
    for line in _lines(card, console):
        console.print(line, markup=False, soft_wrap=True)
    if picture is not None:
        with replacing(picture) as temporary:
            draw_card(card).save(temporary, format="png")


def _list() -> Table:
    table = Table("preset", "type", "device")
    for preset in map(load_preset, preset_names()):
        table.add_row(preset.name, preset.type, preset.description)
    return table


def _lines(card: Card, console: Console) -> list[str]:
    assumed = card.preset.all_assumed()
    drawn = terminal_picture(card) if console.encoding.lower().startswith("utf") else []
    figures = [f"{key}: {value}{' (assumed)' if key in assumed else ''}" for key, value in card.figures()]
    sources = [f"source: {' '.join(preset.source.split())}" for preset in card.preset.lineage()]
    remarks = [f"assumed: {key}: {' '.join(why.split())}" for key, why in assumed.items()]
    return [card.title, f"type: {card.preset.type}", *card.summary(), *drawn, *figures, *sources, *remarks]
