"""The command line. Each command is a module of the same name, imported when it is called; `common` is what they share.

An InputError anywhere becomes its message on stderr and exit code 2; Ctrl-C is exit code 130. Where nobody
reads standard output to its end, as in `rigcast presets | head`, the command ends without a word; where it cannot be
written, with one line. Where standard error cannot be written, words are lost and the exit code stays.
"""

import sys
import traceback
from importlib import import_module
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperGroup

from rigcast.cli.common.streams import prepare_streams, why_unwritable
from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of


class _About(NamedTuple):
    summary: str
    examples: tuple[str, ...]


_COMMANDS = {
    "init": _About(
        "Write a first rig for a MuJoCo model, with comments.",
        ("rigcast init robot.xml", "rigcast init robot.xml --out rig.yaml"),
    ),
    "run": _About(
        "Simulate a rig on its model and write the frames of its sensors.",
        ("rigcast run rig.yaml --duration 3", "rigcast run rig.yaml --set sensors.top.rate_hz=5 --format ply,npz"),
    ),
    "check": _About(
        "Compare a rig's rays with MuJoCo's own ray casting.",
        ("rigcast check rig.yaml --rays 50000", "rigcast check rig.yaml --json check.json"),
    ),
    "validate": _About(
        "Check a rig and its model: show all mistakes, or list the sensors.",
        ("rigcast validate rig.yaml", "rigcast validate rig.yaml --model other.xml --json -"),
    ),
    "watch": _About(
        "Draw what a rig's sensors see, again whenever its files are saved.",
        ("rigcast watch rig.yaml --out out/watch",),
    ),
    "view": _About(
        "Show a rig, a recorded run or a ROS 2 bag.",
        ("rigcast view rig.yaml", "rigcast view out/rig --save view.html", "rigcast view a.mcap --save view.rrd"),
    ),
    "publish": _About(
        "Simulate a rig and publish its frames to ROS 2.",
        ("rigcast publish rig.yaml", "rigcast publish rig.yaml --duration 10 --speed 0.5"),
    ),
    "presets": _About(
        "List the device presets, or show the card of one.",
        ("rigcast presets velodyne_vlp16", "rigcast presets livox_avia --picture avia.png --json -"),
    ),
    "schema": _About(
        "Print the JSON schema of rig files or of data sets.",
        ("rigcast schema > rig.schema.json", "rigcast schema dataset > dataset.schema.json"),
    ),
    "dataset": _About(
        "Make a data set: frames of a rig in many scenes and episodes.",
        (
            "rigcast dataset rooms.yaml",
            "rigcast dataset rooms.yaml --engine processes",
            "rigcast dataset rooms.yaml --verify",
        ),
    ),
    "bench": _About(
        "Measure rays per second, beside other ray casters.",
        ("rigcast bench", "rigcast bench warehouse room --caster mj_multiRay --rounds 3 --json bench.json"),
    ),
}
_EXIT_CODES = (
    "Exit codes: 0 done, 1 a ray is wrong (check), an episode failed (dataset) or standard output cannot be written, "
    "2 a mistake in the input, 70 a fault of rigcast itself, 130 interrupted, 141 standard output was closed."
)
_FAULT = 70  # EX_SOFTWARE of sysexits.h; Python would end with 1, which is a wrong ray
_UNREAD = 141  # 128 + SIGPIPE, as of any other program in a pipe; 1, which typer and rich exit with, is a wrong ray


_SETTINGS = {"help_option_names": ["-h", "--help"]}


class _Commands(TyperGroup):
    """Commands by name, imported when called, so that `rigcast --help` loads none of their libraries."""

    def list_commands(self, _ctx: Any) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, _ctx: Any, name: str) -> Any:
        if name not in _COMMANDS:
            return None
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        examples = "\n".join(f"  {example}" for example in _COMMANDS[name].examples)
        command = getattr(import_module(f"rigcast.cli.{name}"), name)
        alone.command(name, epilog=f"\b\nExamples:\n{examples}", context_settings=_SETTINGS)(command)
        return typer.main.get_command(alone)

    def format_commands(self, _ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, about.summary) for name, about in _COMMANDS.items()])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args[0] not in _COMMANDS:
            raise InputError(f"no command {args[0]!r}, {expected_one_of(args[0], list(_COMMANDS))}")
        return super().resolve_command(ctx, args)

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
    epilog=_EXIT_CODES,
    context_settings=_SETTINGS,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version  # imported here, because only this option needs it

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
    prepare_streams()
    try:
        app()
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):
            sys.exit(_UNREAD)
        raise
    except Exception as error:
        reason = why_unwritable() if isinstance(error, OSError) else None
        if reason is None:
            traceback.print_exc()
            sys.exit(_FAULT)
        typer.echo(f"standard output: cannot be written: {reason}", err=True)
        sys.exit(1)
