"""`rigcast watch`: pictures of a rig's readings, drawn again whenever its files are saved."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from rigcast.cli.common.options import Device, ModelPath, Overrides, RigPath, counted, say
from rigcast.cli.common.ready import ready_rig
from rigcast.export.files import make_writable, replacing
from rigcast.motion.simulation import initial_data
from rigcast.rig_file import open_rig
from rigcast.rig_file.layers import refuse_other_names
from rigcast.sensors.errors import InputError

_PERIOD = 0.3  # s between two looks at the files


def watch(
    rig: RigPath,
    model: ModelPath = None,
    out: Annotated[Path | None, typer.Option(help="folder to write to  [default: out/<rig>]")] = None,
    device: Device = None,
    overrides: Overrides = None,
) -> None:
    """Draw what every sensor sees at the start, again whenever the rig, a file that it extends or its model is saved.

    Writes DIR/<sensor>.png until Ctrl-C. A mistake is shown, and the last pictures are kept until it is fixed.
    """
    console = Console(highlight=False)
    folder = Path("out") / rig.stem if out is None else out
    refuse_other_names(rig)
    if not rig.is_file():  # later it may be missing for a moment while an editor saves it
        raise InputError(f"{rig}: no such file, expected a rig")
    make_writable(folder)

    def draw() -> Sequence[Path]:
        return draw_once(console, rig, model, folder, device, overrides or ())

    try:
        keep_drawing(console, rig, draw)
    except KeyboardInterrupt:
        console.print("stopped")


def draw_once(
    console: Console, rig: Path, model: Path | None, folder: Path, device: str | None, overrides: Sequence[str]
) -> Sequence[Path]:
    """Write one picture per sensor in the initial state; return the files that the pictures depend on."""
    began = time.perf_counter()
    config, compiled = open_rig(rig, model, overrides)
    data = initial_data(compiled, config.keyframe)
    loaded = ready_rig(console, config, compiled, data, device)
    for name, frame in loaded.sense(data).items():
        with replacing(folder / f"{name}.png") as temporary:
            frame.picture().save(temporary, format="png")
    seconds = time.perf_counter() - began
    say(console, f"{rig}: {counted(len(config.sensors), 'picture')} in {folder}, {seconds:.1f} s")
    own = model if model is not None else config.model
    return config.files if own is None else (*config.files, own)


def keep_drawing(console: Console, rig: Path, draw: Callable[[], Sequence[Path]]) -> None:
    """Call `draw`, then again whenever a file that it returned is saved. Mistakes are shown."""
    files: Sequence[Path] = (rig,)
    while True:
        before = _saved(files)
        try:
            drawn = draw()
            before = {**_saved(drawn), **before}
            files = drawn
        except InputError as error:
            say(console, str(error))
        while _saved(files) == {path: before[path] for path in files}:
            time.sleep(_PERIOD)


def _saved(files: Sequence[Path]) -> dict[Path, int]:
    """Time at which each file was last saved [ns]; 0 for one that is missing."""
    return {path: path.stat().st_mtime_ns if path.is_file() else 0 for path in files}
