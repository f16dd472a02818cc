"""`rigcast check`: cast a rig's rays and compare each with MuJoCo's own."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from rigcast.checking import Hit, Report, Row, WrongRay
from rigcast.checking import check as check_rig
from rigcast.cli.common.options import (
    Device,
    JsonFile,
    ModelPath,
    Overrides,
    RigPath,
    console_beside,
    say,
    show,
    write_json,
)
from rigcast.cli.common.ready import ready_rig
from rigcast.motion.simulation import initial_data
from rigcast.rig_file import open_rig

COUNTS = ("rays", "agree", "edge", "wrong")


def check(
    rig: RigPath,
    model: ModelPath = None,
    rays: Annotated[int, typer.Option(min=1, help="total number of rays, over all sensors and states")] = 20_000,
    json_file: JsonFile = None,
    device: Device = None,
    overrides: Overrides = None,
) -> None:
    """Compare the rays of every sensor with MuJoCo's own ray casting. Exits with 1 if any ray is wrong."""
    console = console_beside(json_file)
    config, compiled = open_rig(rig, model, overrides or ())
    data = initial_data(compiled, config.keyframe)
    loaded = ready_rig(console, config, compiled, data, device)
    report = check_rig(loaded, data, rays=rays)
    show(console, _table(report))
    for wrong in report.wrong_rays:
        say(console, _sentence(wrong))
    if report.not_judged:
        say(console, f"{report.not_judged} rays end on flexes or skins: not judged before MuJoCo 4")
    say(console, _verdict(rig, report))
    if json_file is not None:
        write_json(json_file, as_json(rig, report))
    if report.wrong:
        raise typer.Exit(1)


def as_json(rig: Path, report: Report) -> str:
    """Return the report as JSON: totals, rows, wrong rays. A distance of null is a miss."""
    totals = {name: getattr(report, name) for name in COUNTS}
    return json.dumps({"rig": str(rig), **totals, **asdict(report)}, indent=1, allow_nan=False) + "\n"


def _table(report: Report) -> Table:
    table = Table("sensor", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.caption = r"worst, 99.9 %: |t - t_ref| \[um] of rays that agree; of allowed: largest share of the tolerance"
    table.add_column("hit", no_wrap=True)
    for column in ("rays", "agree", "edge band", "wrong", "worst", "99.9 %", "of allowed"):
        table.add_column(column, justify="right", no_wrap=True)
    previous = None
    for row in report.rows:
        if previous not in (None, row.sensor):
            table.add_section()
        table.add_row("" if row.sensor == previous else escape(row.sensor), row.geom_type, *_cells(row))
        previous = row.sensor
    return table


def _cells(row: Row) -> tuple[str, ...]:
    counts = [f"{getattr(row, name)}" for name in COUNTS]
    if row.wrong:
        counts[-1] = f"[bold red]{counts[-1]}[/]"
    return (*counts, f"{row.worst_error * 1e6:.2f}", f"{row.p999_error * 1e6:.2f}", f"{row.worst_of_bound:.1%}")


def _sentence(wrong: WrongRay) -> str:
    """Return a wrong ray in words, with everything needed to cast it again."""
    return (
        f"wrong: {wrong.sensor}, ray {list(wrong.ray)}, after {wrong.step} steps, t = {wrong.time:.17g} s\n"
        f"  from {list(wrong.origin)} along {list(wrong.direction)}\n"
        f"  got      {_hit(wrong.got)}\n"
        f"  expected {_hit(wrong.expected)}"
    )


def _hit(hit: Hit) -> str:
    if hit.id == -1 and hit.distance is None:
        return "no hit"
    name = f" {hit.name!r}" if hit.name else ""
    distance = "no distance" if hit.distance is None else f"{hit.distance:.9g} m"
    return f"{distance}, {hit.kind or 'id'} {hit.id}{name}, normal {[round(x, 6) for x in hit.normal]}"


def _verdict(rig: Path, report: Report) -> str:
    band = f"{report.edge} in the edge band ({report.edge / report.rays:.3%})"
    return f"{rig}: {report.wrong} of {report.rays} rays are wrong, in {len(report.times)} states; {band}"
