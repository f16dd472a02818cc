"""`rigcast init`: a first rig for a model."""

import os
import shlex
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from rigcast.export.files import make_room_for, replacing
from rigcast.rig_file import compile_model
from rigcast.rig_file.starter import starter_rig
from rigcast.sensors.errors import InputError


def init(
    model: Annotated[Path, typer.Argument(help="MuJoCo model: MJCF, URDF or MJB", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="file to write  [default: <model>.yaml in this folder]")] = None,
    force: Annotated[bool, typer.Option("--force", help="overwrite an existing file")] = False,
) -> None:
    """Write a first rig for a model, with comments: sensors on its cameras and on sites named like one."""
    compiled = compile_model(model)
    path = Path(f"{model.stem}.yaml") if out is None else out
    make_room_for(path)
    if path.exists() and not force:
        raise InputError(f"{path}: already exists; --force overwrites it")
    schema = str(files("rigcast.configs") / "rig.schema.json")
    with replacing(path) as temporary:
        temporary.write_text(starter_rig(compiled, _beside(path, model), schema), encoding="utf-8")
    name = shlex.quote(str(path))
    typer.echo(f"{path}: written; try `rigcast validate {name}` and `rigcast run {name}`")


def _beside(rig: Path, model: Path) -> str:
    """The path of the model for the rig file: relative to the file's folder if possible."""
    try:
        return Path(os.path.relpath(model.resolve(), rig.parent.resolve())).as_posix()
    except ValueError:  # on another drive
        return str(model.resolve())
