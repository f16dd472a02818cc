"""`rigcast schema`: the JSON schema of rig files, or of data set files, for editors and other tools."""

import json
from typing import Annotated, Literal

import typer

from rigcast.schema import dataset_schema, rig_schema

_SCHEMAS = {"rig": rig_schema, "dataset": dataset_schema}


def schema(
    of: Annotated[Literal["rig", "dataset"], typer.Argument(help="kind of file")] = "rig",
) -> None:
    """Print the JSON schema of rig files or of data sets (for `# yaml-language-server: $schema=...`)."""
    typer.echo(json.dumps(_SCHEMAS[of](), indent=2, allow_nan=False))
