"""`rigcast schema`: what may stand in a rig file, for editors and other tools."""

import json

import typer

from rigcast.config import RigFile


def schema() -> None:
    """Print the JSON schema of rig files (for `# yaml-language-server: $schema=...`)."""
    document = {"$schema": "https://json-schema.org/draft/2020-12/schema", **RigFile.model_json_schema()}
    typer.echo(json.dumps(document, indent=2, allow_nan=False))
