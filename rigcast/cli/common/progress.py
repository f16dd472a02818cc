"""The progress of a simulation."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from rigcast.cli.common.options import counted


@contextmanager
def progress(console: Console, duration: float) -> Iterator[Callable[[float, int], None]]:
    """Yield a function to call with the time simulated [s] and the number of frames written.

    On a terminal it moves a progress bar; elsewhere it prints a line at every quarter.
    """
    if console.is_terminal:
        with _bar(console) as bar:
            task = bar.add_task("simulating", total=duration, frames=0)
            yield lambda time, frames: bar.update(task, completed=time, frames=frames)
    else:
        yield _quarterly(console, duration)


def _bar(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.2f} of {task.total:.2f} s  {task.fields[frames]} frames  remaining"),
        TimeRemainingColumn(),
        console=console,
    )


def _quarterly(console: Console, duration: float) -> Callable[[float, int], None]:
    quarters = 0
    began = perf_counter()

    def report(time: float, frames: int) -> None:
        nonlocal quarters
        if int(4.0 * time / duration + 1e-9) > quarters:
            quarters = int(4.0 * time / duration + 1e-9)
            left = (perf_counter() - began) * (duration / time - 1.0)
            console.print(f"simulated {time:.2f} of {duration:.2f} s, {counted(frames, 'frame')}, {left:.0f} s left")

    return report
