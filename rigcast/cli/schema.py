"""`rigcast schema`: what may stand in a rig file, for editors and other tools."""

import json

import typer

from rigcast.schema import rig_schema


def schema() -> None:
    """Print the JSON schema of rig files (for `# yaml-language-server: $schema=...`)."""
    typer.echo(json.dumps(rig_schema(), indent=2, allow_nan=False))
