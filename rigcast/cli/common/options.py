"""Options shared by commands, and the output of results."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from rigcast.export.files import make_room_for, replacing
from rigcast.sensors.errors import InputError

RigPath = Annotated[Path, typer.Argument(help="the rig, a YAML file", show_default=False)]
ModelPath = Annotated[Path | None, typer.Option(help="MuJoCo model to use instead of the rig's own")]
Device = Annotated[str | None, typer.Option(help="cpu, cuda:0...  [default: CUDA if present]")]
Seed = Annotated[int | None, typer.Option(min=0, help="seed to use instead of the rig's own")]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="override a key of the rig, such as sensors.top.rate_hz=5; repeatable"
    ),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", help="JSON file to write the result to; - for standard output, and nothing else there"),
]

_STANDARD_OUTPUT = Path("-")
_WIDEST = 1000  # columns of a table that is not on a terminal


def console_beside(json_file: Path | None) -> Console:
    """The console for tables and messages; it is silent if JSON goes to standard output.

    Raises InputError, before anything is computed, if the file could not be written.
    """
    if json_file not in (None, _STANDARD_OUTPUT):
        make_room_for(json_file)
    return Console(highlight=False, quiet=json_file == _STANDARD_OUTPUT)


def require_png(option: str, picture: Path | None) -> None:
    """Raise InputError, before anything is computed, if a picture is not named as a PNG or cannot be written."""
    if picture is None:
        return
    if picture.suffix.lower() != ".png":
        raise InputError(f"{option}: got {str(picture)!r}, expected a name that ends in .png")
    make_room_for(picture)


def say(console: Console, line: str) -> None:
    """Print a line as it is, without markup and without wrapping."""
    console.print(line, markup=False, soft_wrap=True)


def show(console: Console, table: Table) -> None:
    """Print a table without cutting names short: on a terminal they are folded, elsewhere it is as wide as it needs."""
    for column in table.columns:
        if not column.no_wrap:
            column.overflow = "fold"
    if not console.is_terminal:
        widest = console.measure(table, options=console.options.update_width(_WIDEST)).maximum
        console.width = max(console.width, widest)
    console.print(table)


def counted(count: int, noun: str) -> str:
    """ "1 frame", "2 frames"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def write_json(json_file: Path, text: str) -> None:
    """Write JSON to a file, or to standard output. Raises InputError if the file cannot be written."""
    if json_file == _STANDARD_OUTPUT:
        typer.echo(text, nl=False)
        return
    with replacing(json_file) as temporary:
        temporary.write_text(text)
