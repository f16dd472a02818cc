"""`rigcast validate`: check a rig and its model without casting a ray."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rigcast.config import open_rig
from rigcast.sensors.specs.mount import Mount


def validate(
    rig: Annotated[Path, typer.Argument(help="the rig, a YAML file", show_default=False)],
    model: Annotated[Path | None, typer.Option(help="MuJoCo model in place of the rig's own")] = None,
) -> None:
    """Check a rig and its model; show every mistake, or the sensors."""
    config, compiled = open_rig(rig, model)
    table = Table("sensor", "type", "rays", "rate", "mount")
    for sensor in config.sensors:
        rays = " x ".join(str(extent) for extent in sensor.pattern(compiled).shape)
        rate = "every step" if sensor.rate_hz is None else f"{sensor.rate_hz:g} Hz"
        table.add_row(sensor.name, sensor.type, rays, rate, escape(_place(sensor.mount)))
    console = Console(highlight=False)
    console.print(table)
    console.print(escape(f"{rig}: valid, {len(config.sensors)} sensor(s)"), soft_wrap=True)


def _place(mount: Mount) -> str:
    return "world" if mount.parent == "world" else f"{mount.parent} {getattr(mount, mount.parent)}"
