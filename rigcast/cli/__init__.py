"""The command line. Each command is a module of the same name, imported when it is called.

An InputError anywhere becomes its message on stderr and exit code 2; Ctrl-C is exit code 130.
"""

from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rigcast.sensors.errors import InputError

_COMMANDS = {
    "run": "Run a rig on its model and write what its sensors see.",
    "check": "Compare what a rig's sensors see with MuJoCo's own ray casting.",
    "publish": "Run a rig and publish what its sensors see to ROS 2.",
    "validate": "Check a rig and its model; show every mistake, or the sensors.",
    "presets": "List the device presets, or show one.",
    "schema": "Print the JSON schema of rig files.",
    "bench": "Measure rays per second, beside MuJoCo's.",
}


class _Commands(TyperGroup):
    """Knows its commands by name, so that `rigcast --help` waits for none of their libraries."""

    def list_commands(self, _ctx: Any) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, _ctx: Any, name: str) -> Any:
        if name not in _COMMANDS:
            return None
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(name)(getattr(import_module(f"rigcast.cli.{name}"), name))
        return typer.main.get_command(alone)

    def format_commands(self, _ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except InputError as error:
            typer.echo(str(error), err=True)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            typer.echo("interrupted", err=True)
            raise typer.Exit(130) from None


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rigcast {version('rigcast')}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Ray-cast lidars and depth cameras for MuJoCo."""


def main() -> None:
    """Entry point of the `rigcast` command."""
    app()
