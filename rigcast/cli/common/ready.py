"""Rigs for commands: Warp is silenced; the compilation of kernels and warnings are reported."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Timer

import mujoco
from rich.console import Console

from rigcast.cli.common.options import say
from rigcast.quiet import quiet_warp
from rigcast.rig_file import RigConfig
from rigcast.sensors.device import compiling
from rigcast.sensors.rig.rig import Rig

_PATIENCE = 1.5  # s; cached kernels load in less


def ready_rig(
    console: Console,
    config: RigConfig,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    device: str | None,
    seed: int | None = None,
) -> Rig:
    """The rig of a file with its kernels compiled by one cast in the state of `data`."""
    quiet_warp()
    with word_if_compiling(console), warnings_as_words(console, set()), compiling():
        rig = config.build(model, device, seed)
        rig.sense(data)
    return rig


@contextmanager
def warnings_as_words(console: Console, told: set[str]) -> Iterator[None]:
    """Print the warnings of the body at its end, without their place in the code, unless they are in `told` by then."""
    with warnings.catch_warnings(record=True, action="always", category=UserWarning) as caught:
        yield
    for words in dict.fromkeys(str(warning.message) for warning in caught):
        if words not in told:
            told.add(words)
            say(console, words)


@contextmanager
def word_if_compiling(console: Console) -> Iterator[None]:
    """Print that kernels are being compiled if the body takes longer than loading them would."""
    timer = Timer(_PATIENCE, _say_compiling, [console])
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _say_compiling(console: Console) -> None:
    # where nobody reads on, console.print would silence the console and end this thread alone, and the command would
    # end with 0; so its own next output fails, too, and reports it
    with suppress(OSError):
        if not console.quiet:
            print("compiling kernels, on first use only: about 20 s", file=console.file, flush=True)
