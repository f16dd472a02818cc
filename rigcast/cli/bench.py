"""`rigcast bench`: how fast rigcast is here, beside other ray casters."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from rigcast.bench.casters import CASTERS, Caster, load_casters
from rigcast.bench.casting import origins, outputs, patterns
from rigcast.bench.figure import Figure, Spread
from rigcast.bench.preparing import memory, start, trees
from rigcast.bench.race import Result, race
from rigcast.bench.report.charts import draw_results, draw_scaling, draw_worlds
from rigcast.bench.report.record import Record
from rigcast.bench.scaling import Series, scaling
from rigcast.bench.stepping import small, update
from rigcast.bench.workloads import WORKLOADS, Unavailable, hills
from rigcast.bench.worlds.crowd import G1_HEAD, crowd
from rigcast.bench.worlds.measure import Batch, OnDevice, measure_worlds
from rigcast.cli.common.options import JsonFile, console_beside, require_png, say, show, write_json
from rigcast.kernels.launching.slices import thread_count
from rigcast.quiet import quiet_warp
from rigcast.sensors.device import find_device
from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.threads import set_threads

_FIGURES = {each.__name__: each for each in (patterns, outputs, origins, update, small, trees, memory, start)}
_PARTS = (*WORKLOADS, *_FIGURES, "scaling", "worlds")
_SIZES, _SIZES_ON_CUDA = (16, 64), (64, 256, 1024, 4096, 16384)


@dataclass(frozen=True)
class Extent:
    """The extent of measurements: rounds, triangles of the largest height field, numbers of worlds on a device."""

    rounds: int
    triangles: int
    worlds: Sequence[int] | None
    device: str | None


def bench(
    what: Annotated[
        list[str] | None, typer.Argument(help=f"any of {', '.join(_PARTS)}, or all", show_default="warehouse")
    ] = None,
    caster: Annotated[
        list[str] | None, typer.Option(help=f"any of {', '.join(CASTERS)}  [default: those installed]")
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="how often each caster is timed")] = 7,
    threads: Annotated[int | None, typer.Option(min=1, max=9999, help="CPU threads  [default: all]")] = None,
    triangles: Annotated[int, typer.Option(min=2, help="triangles of the largest height field")] = 1_000_000,
    worlds: Annotated[
        list[int] | None,
        typer.Option(min=1, help="numbers of worlds for `worlds`  [default: 64 to 16384 on CUDA, else 16 and 64]"),
    ] = None,
    device: Annotated[
        str | None, typer.Option(help="device for `worlds`: cpu, cuda:0...  [default: CUDA if present]")
    ] = None,
    json_file: JsonFile = None,
    chart: Annotated[Path | None, typer.Option(help="PNG file for a bar chart of the casters' speeds")] = None,
    scaling_chart: Annotated[Path | None, typer.Option(help="PNG file for plots of `scaling`")] = None,
    worlds_chart: Annotated[Path | None, typer.Option(help="PNG file for a plot of `worlds`")] = None,
) -> None:
    """Time rigcast and other ray casters on the CPU, interleaved on the same rays, and compare their hits.

    warehouse is the demo's scene; g1, aloha_pot, room and hills are other scenes. patterns, outputs, origins, update,
    small, trees, memory and start measure rigcast alone; scaling measures its speed as scenes grow. worlds casts a
    lidar of 1024 rays on the g1 in each of many worlds, beside mujoco_warp, on CUDA if there is a GPU.
    """
    parts = _as_parts(what or ["warehouse"])
    if threads is not None:
        set_threads(threads)
    console = console_beside(json_file)
    require_png("--chart", chart)
    require_png("--scaling-chart", scaling_chart)
    require_png("--worlds-chart", worlds_chart)
    quiet_warp()
    casters, missing = load_casters(tuple(dict.fromkeys(("rigcast", *(caster or CASTERS)))))
    for line in missing:
        say(console, f"left out: {line}")
    console.print(f"rigcast {version('rigcast')} on {thread_count()} CPU threads, {rounds} rounds in turn")
    record = Record.begun(rounds)
    measure(console, parts, casters, Extent(rounds, triangles, worlds, device), record)
    if chart is not None:
        draw_results(record.results, chart)
    if scaling_chart is not None:
        draw_scaling(record.scaling, scaling_chart)
    if worlds_chart is not None and record.worlds is not None:
        draw_worlds(record.worlds.by_way(), worlds_chart)
    if json_file is not None:
        write_json(json_file, record.as_json())


def measure(
    console: Console, parts: Sequence[str], casters: Sequence[type[Caster]], extent: Extent, record: Record
) -> None:
    """Measure the parts, add the results to the record, and show each when it is done."""
    for part in parts:
        with console.status(part):
            if part in WORKLOADS:
                record.results += _race(console, part, casters, extent)
            elif part in _FIGURES:
                record.figures += _shown(console, _FIGURES[part](extent.rounds))
            elif part == "scaling":
                record.scaling += _plotted(console, scaling(extent.rounds, extent.triangles))
            else:
                record.worlds = _in_worlds(console, casters, extent)


def _as_parts(what: Sequence[str]) -> list[str]:
    for part in what:
        if part != "all" and part not in _PARTS:
            raise InputError(f"bench: no part {part!r}, {expected_one_of(part, [*_PARTS, 'all'])}")
    return list(_PARTS) if "all" in what else list(dict.fromkeys(what))


def _race(console: Console, name: str, casters: Sequence[type[Caster]], extent: Extent) -> Sequence[Result]:
    try:
        workload = hills(extent.triangles) if name == "hills" else WORKLOADS[name]()
    except Unavailable as reason:
        say(console, f"left out: {name}: {reason}")
        return ()
    results = race(workload, casters, extent.rounds)
    show(console, _table(results))
    return results


def _in_worlds(console: Console, casters: Sequence[type[Caster]], extent: Extent) -> OnDevice | None:
    device = find_device(extent.device)
    sizes = extent.worlds or (_SIZES_ON_CUDA if device.is_cuda else _SIZES)
    try:
        robots = crowd(WORKLOADS["g1"](), G1_HEAD, max(sizes))
    except Unavailable as reason:
        say(console, f"left out: worlds: {reason}")
        return None
    found = measure_worlds(robots, sizes, device, [caster.name for caster in casters], extent.rounds)
    console.print(f"worlds on {found.device}: {found.workload}, {found.geoms} geoms, {found.triangles} triangles")
    show(console, _table_of_worlds(found.batches))
    for line in _about_worlds(found):
        say(console, line)
    return found


def _shown(console: Console, figures: Iterator[Figure]) -> Iterator[Figure]:
    for figure in figures:
        say(console, f"{figure.what}: {_spread(figure.value)} {figure.unit}")
        yield figure


def _plotted(console: Console, found: Iterator[Series]) -> Iterator[Series]:
    for series in found:
        pairs = zip(series.sizes, series.mrays, strict=True)
        console.print(f"{series.varies}:", ", ".join(f"{size}: {mrays.median:.3g} M rays/s" for size, mrays in pairs))
        yield series


def _spread(value: Spread) -> str:
    if value.lowest == value.highest:
        return f"{value.median:.3g}"
    return f"{value.median:.3g} ({value.lowest:.3g} to {value.highest:.3g})"


def _table(results: Sequence[Result]) -> Table:
    table = Table("rays", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.caption = "M rays/s, with scene update and numpy; ratio: rigcast's to it; agree, 1 cm: with mj_ray"
    for column in ("caster", "median", "lowest", "highest", "ratio", "agree", "1 cm"):
        table.add_column(column, justify="left" if column == "caster" else "right", no_wrap=True)
    for result in results:
        where = f"{result.workload}, {result.sensor} {' x '.join(map(str, result.shape))}"
        for speed in result.speeds:
            speeds = (f"{value:.3g}" for value in (speed.mrays.median, speed.mrays.lowest, speed.mrays.highest))
            right = f"{speed.agree:.2%}", f"{speed.close:.2%}"
            table.add_row(where, speed.caster, *speeds, f"{speed.ratio.median:.2f}", *right)
            where = ""
        table.add_section()
    return table


def _table_of_worlds(batches: Sequence[Batch]) -> Table:
    table = Table("worlds", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.caption = "of 1024 rays each, from poses on the device into arrays there; ratio: rigcast's rays/s to it"
    for column in ("way", "ms", "M rays/s", "ratio"):
        table.add_column(column, justify="left" if column == "way" else "right", no_wrap=True)
    for batch in batches:
        where = str(batch.worlds)
        for way in batch.ways:
            table.add_row(where, way.name, _spread(way.ms), f"{way.mrays.median:.3g}", f"{way.ratio.median:.2f}")
            where = ""
        table.add_section()
    return table


def _about_worlds(found: OnDevice) -> Iterator[str]:
    for batch in found.batches:
        for part in batch.parts:
            yield f"{batch.worlds} worlds: {part.what}: {_spread(part.value)} {part.unit}"
        for right in batch.right:
            shares = f"distance {right.agree:.2%}, to 1 cm {right.close:.2%}, geom {right.geom:.2%}"
            yield f"{batch.worlds} worlds: {right.caster}: as mj_ray: {shares}"
        if batch.same is not None:
            yield f"{batch.worlds} worlds: both casters alike to 1 cm, geom and all: {batch.same:.3%}"
    for figure in found.limits:
        yield f"{figure.what}: {_spread(figure.value)} {figure.unit}"
