"""`rigcast dataset`: a rig in many scenes and episodes, on one CPU or on a cluster."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.filesize import decimal
from rich.table import Table

from rigcast.cli.common.options import Device, counted, say, show
from rigcast.cli.common.progress import progress
from rigcast.cli.common.ready import warnings_as_words, word_if_compiling
from rigcast.dataset.description.config import DatasetConfig, read_dataset
from rigcast.dataset.making.engines import Engine, InProcess, Processes, Ray
from rigcast.dataset.making.episode import Result
from rigcast.dataset.making.generate import Done, make_dataset, missing_units
from rigcast.dataset.making.rehearsal import rehearse
from rigcast.dataset.reading import open_dataset
from rigcast.dataset.storage.manifest import MANIFEST_NAME
from rigcast.dataset.storage.shards import ENTRY_NAME, without_entry
from rigcast.dataset.storage.stores import is_url
from rigcast.export.files import make_writable
from rigcast.sensors.errors import InputError

_SHOWN = 20  # reasons of failed episodes shown on the terminal; the manifest has them all
EngineName = Literal["in-process", "processes", "ray"]


def dataset(
    config: Annotated[Path, typer.Argument(help="the data set, a YAML file", show_default=False)],
    out: Annotated[
        str | None, typer.Option(help="folder to write to; with --verify also a URL  [default: out/<config>]")
    ] = None,
    engine: Annotated[EngineName, typer.Option(help="where episodes are made")] = "in-process",
    workers: Annotated[
        int | None, typer.Option(min=1, help="number of workers for processes and ray  [default: one per CPU]")
    ] = None,
    address: Annotated[
        str | None, typer.Option(help="address of a Ray cluster to join, or auto; implies --engine ray")
    ] = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="make only the I-th of N parts, I from 1 to N")
    ] = None,
    device: Device = None,
    verify: Annotated[bool, typer.Option("--verify", help="only compare existing files with their checksums")] = False,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="override a key of the file, such as episodes.count=3"),
    ] = None,
) -> None:
    """Make a data set, or the missing part of it. After an interruption, run the same command again."""
    console = Console(highlight=False)
    if verify:
        _verify(console, out if out is not None and is_url(out) else _folder(config, out))
        return
    if out is not None and is_url(out):
        raise InputError(f"--out: got {out}: data sets are written to folders; copy what is finished there")
    folder = _folder(config, out)
    read = read_dataset(config, overrides or ())
    part = _part(shard)
    chosen = _engine("ray" if address is not None else engine, address, workers)
    missing = missing_units(read, folder, part)
    count = len(read.units()[part[0] - 1 :: part[1]])
    say(console, f"{config}: {len(missing)} of {count} episodes to make, {chosen.workers} at a time, in {folder}")
    for place in without_entry(folder, [unit.name for unit in missing]):
        say(console, f"{place}: has no {ENTRY_NAME}, so it is incomplete: made again")
    told = set[str]()
    if missing:
        make_writable(next(place for place in (folder, *folder.parents) if place.exists()))
        with word_if_compiling(console), warnings_as_words(console, told):
            rehearse(read, folder, device)
    with progress(console, max(1, len(missing)) * read.file.episodes.duration) as report:
        reported = _counting(report, read.file.episodes.duration)
        try:
            with warnings_as_words(console, told):
                done = make_dataset(read, folder, chosen, device=device, part=part, report=reported)
        except KeyboardInterrupt:
            say(console, f"{folder}: finished episodes are kept; run the same command again to continue")
            raise
    _tell(console, read, folder, done, chosen.workers)
    if done.manifest["failed"]:
        raise typer.Exit(1)


def _folder(config: Path, out: str | None) -> Path:
    return (Path("out") / config.stem if out is None else Path(out)).absolute()


def _part(shard: str | None) -> tuple[int, int]:
    """`"2/8"` as (2, 8)."""
    if shard is None:
        return 1, 1
    numbers = shard.split("/")
    if len(numbers) != 2 or not all(number.isdecimal() for number in numbers) or int(numbers[1]) == 0:
        raise InputError(f"--shard: got {shard!r}, expected I/N, such as 1/8")
    i, n = map(int, numbers)
    if not 1 <= i <= n:
        raise InputError(f"--shard: got {shard}, expected a part from 1/{n} to {n}/{n}")
    return i, n


def _engine(name: EngineName, address: str | None, workers: int | None) -> Engine:
    if name == "in-process":
        if workers is not None:
            raise InputError(f"--workers: got {workers} with --engine in-process, expected --engine processes or ray")
        return InProcess()
    return Processes(workers) if name == "processes" else Ray(address, workers)


def _counting(report: Callable[[float, int], None], duration: float) -> Callable[[Result], None]:
    """A function of results that passes the total simulated time and number of frames to a progress bar."""
    time, frames = 0.0, 0

    def add(result: Result) -> None:
        nonlocal time, frames
        time, frames = time + duration, frames + result.frames
        report(time, frames)

    return add


def _verify(console: Console, place: str | Path) -> None:
    read = open_dataset(place)
    faults = read.verify()
    for fault in faults:
        say(console, fault)
    shards = read.manifest["shards"]
    files = counted(sum(len(entry["files"]) for entry in shards), "file")
    found = f"{files} of {counted(len(shards), 'episode')}, {counted(len(read), 'frame')}"
    words = f"{len(faults)} wrong" if faults else "all unchanged"
    say(console, f"{place}: {found}, {words}")
    if faults:
        raise typer.Exit(1)


def _tell(console: Console, config: DatasetConfig, folder: Path, done: Done, workers: int) -> None:
    manifest = done.manifest
    show(console, _table(manifest["statistics"]))
    alike: dict[str, list[dict[str, Any]]] = {}
    for failure in manifest["failed"]:
        alike.setdefault(failure["reason"], []).append(failure)
    for reason, (first, *others) in list(alike.items())[:_SHOWN]:
        more = f" and {counted(len(others), 'other')}" if others else ""
        say(console, f"failed: {first['scene']}, episode {first['episode']} (seed {first['seed']}){more}: {reason}")
    size = sum(file["size"] for entry in manifest["shards"] for file in entry["files"].values())
    have = f"{len(manifest['shards'])} of {len(config.units())} episodes, {decimal(size)}"
    lacking = f"{len(manifest['failed'])} failed, {manifest['missing']} not made yet"
    say(console, f"{folder / MANIFEST_NAME}: {have}; {lacking}")
    if done.episodes:
        say(console, _throughput(done, workers))


def _table(statistics: dict[str, dict[str, Any]]) -> Table:
    table = Table("sensor")
    for column in ("frames", "rays", "hit", r"range \[m]"):
        table.add_column(column, justify="right")
    for name, one in statistics.items():
        hits, rays, span = one["hits"], one["rays"], one["range"]
        shown = "" if span is None else f"{span[0]:.2f} to {span[2]:.2f}, mean {span[1]:.2f}"
        table.add_row(name, str(one["frames"]), str(rays), f"{100 * hits / max(1, rays):.0f} %", shown)
    return table


def _throughput(done: Done, workers: int) -> str:
    """Frames and bytes per second, and the workers' time by purpose; the largest share is the bottleneck."""
    rates = f"{done.frames / done.seconds:.1f} frames/s, {decimal(int(done.size / done.seconds))}/s"
    purposes = {**vars(done.spent)}
    purposes["waiting"] = max(0.0, workers * done.seconds - sum(purposes.values()))
    shares = {name: 100 * seconds / (workers * done.seconds) for name, seconds in purposes.items()}
    limit = max(shares, key=lambda name: shares[name])
    listed = ", ".join(f"{name} {share:.0f} %" for name, share in shares.items())
    made = f"{counted(done.episodes, 'episode')} in {done.seconds:.1f} s: {rates}"
    return f"{made}; the limit is {limit} ({listed} of the workers' time)"
