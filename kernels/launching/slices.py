"""Launches of kernels over many rays: on CUDA as one launch, on the CPU as slices over threads."""

import os
from collections.abc import Callable, Sequence
from functools import cache, partial
from queue import SimpleQueue
from threading import Thread
from typing import Any, NoReturn

import warp as wp

from .launch import launch
from .recorded import recorded

RAYS_PER_SLICE = 8192
TURN = wp.constant(16)
"""Number of tiles that a thread claims per turn, in kernels whose turns all have the same length."""
RAYS_PER_RUN, RUNS_PER_SLICE = 1024, 128
"""Slices of at least 131072 rays, because waking a thread takes as long as reading tens of thousands of rays."""


def launch_over_rays(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
    slice_size: int = RAYS_PER_SLICE,
) -> None:
    """Launch a kernel over items 0..count-1, such as rays. Its first argument is the item of thread 0 of the launch.

    The result of an item must depend on that item alone, so that slices and threads do not affect it. slice_size: items
    that a CPU thread takes at a time.
    """

    if wp.get_device(device).is_cuda or count <= slice_size or thread_count() == 1:
        launch(kernel, count, [0, *inputs], outputs, device)
        return
    slices = iter(range(0, count, slice_size))

    def take_slices() -> None:
        for first in slices:
            launch(kernel, min(slice_size, count - first), [first, *inputs], outputs, device)

    threads = min(thread_count(), -(-count // slice_size))
    _at_once([take_slices] * threads, thread_count())


def launch_over_runs(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
) -> None:
    """Launch a kernel that does little per ray: on the CPU each of its threads handles a run of rays, on CUDA one ray.

    The kernel's first arguments are the index of the run of thread 0 and the number of rays per run; the last run may
    have fewer. A CPU thread takes at least RUNS_PER_SLICE runs.
    """
    run, runs, slice_size = _runs_of(count, device)
    launch_over_rays(kernel, runs, [run, *inputs], outputs, device, slice_size)


def prepare_over_runs(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
) -> Callable[[], object]:
    """A repeatable `launch_over_runs`; structs among the arguments are read anew at each call."""
    run, runs, slice_size = _runs_of(count, device)
    return prepare_over_rays(kernel, runs, [run, *inputs], outputs, device, slice_size)


def _runs_of(count: int, device: wp.DeviceLike) -> tuple[int, int, int]:
    """For this many rays: rays per run, number of runs, and runs per slice."""
    run = 1 if wp.get_device(device).is_cuda else RAYS_PER_RUN
    runs = -(-count // run)
    return run, runs, max(RUNS_PER_SLICE, -(-runs // thread_count()))


def prepare_over_rays(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
    slice_size: int = RAYS_PER_SLICE,
) -> Callable[[], object]:
    """A repeatable `launch_over_rays`; structs among the arguments are read anew at each call.

    If one slice suffices, the arguments are packed here once, which takes longer than a kernel needs for a few rays.
    """
    if count and (wp.get_device(device).is_cuda or count <= slice_size):
        return recorded(kernel, count, [0, *inputs], outputs, device)
    return partial(launch_over_rays, kernel, count, inputs, outputs, device, slice_size)


class OverTiles:
    """A repeatable launch of a CPU kernel over tiles 0..count-1.

    The kernel is launched once in each thread. There it claims turns or runs of tiles until none are left; see
    rigcast.kernels.launching.turns. Its arguments are the number of the thread, an array (1,) of int that begins as 0
    and counts the turns or tiles claimed, and `inputs(threads)`.
    """

    def __init__(self, kernel: wp.Kernel, count: int, inputs: Callable[[int], Sequence[Any]]) -> None:
        self.count = count
        self._kernel, self._inputs = kernel, inputs
        self._turns = wp.zeros(1, dtype=int, device="cpu")
        self._taken = self._turns.numpy()
        self._of_threads: list[Callable[[], None]] = []

    def begin(self, threads: int) -> list[Callable[[], None]]:
        """Start over with no tile claimed; return at least `threads` callables, each for one thread.

        Any one of them alone completes the launch.
        """
        if threads > len(self._of_threads):
            given = self._inputs(threads)
            self._of_threads = [recorded(self._kernel, 1, [k, self._turns, *given], [], "cpu") for k in range(threads)]
        self._taken[0] = 0
        return self._of_threads

    def __call__(self) -> None:
        self.launch_with([])

    def launch_with(self, others: Sequence["OverTiles"]) -> None:
        """Make this launch and others together: each thread begins with another and goes on when no tile is left."""
        tiles = self.count
        for other in others:
            tiles += other.count
        available = 1 if tiles <= TURN else thread_count()
        if available == 1:
            self.begin(1)[0]()
            for other in others:
                other.begin(1)[0]()
            return
        threads = min(-(-tiles // TURN), available)
        begun = [launch.begin(threads) for launch in (self, *others)]
        _at_once([partial(_call_each, begun, k, len(begun) * k // threads) for k in range(threads)], available)


def _call_each(begun: Sequence[Sequence[Callable[[], None]]], thread: int, first: int) -> None:
    """Call a thread's part of every launch, beginning with launch `first` and wrapping around."""
    for k in range(first - len(begun), first):
        begun[k][thread]()


def thread_count() -> int:
    """Number of CPU threads to build trees and cast with: RIGCAST_THREADS, or all CPUs that this process may use."""
    wanted = os.environ.get("RIGCAST_THREADS")
    return int(wanted) if wanted else cpu_count()


def cpu_count() -> int:
    """Number of CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _at_once(takers: Sequence[Callable[[], object]], threads: int) -> None:
    """Run callables that share work: the first in this thread, the others in a pool of `threads` threads.

    Each takes work until none is left. So one that has not begun when the first returns has nothing to do and is not
    waited for. An exception of any of them is raised here.
    """
    is_over: list[bool] = []
    errors: list[BaseException] = []
    at_work: set[int] = set()
    done: SimpleQueue[None] = SimpleQueue()

    def take(k: int) -> None:
        at_work.add(k)
        try:
            if not is_over:
                takers[k]()
        except BaseException as error:
            errors.append(error)
        at_work.remove(k)
        done.put(None)

    waiting = _waiting(threads)
    try:
        for k in range(1, len(takers)):
            waiting.put(partial(take, k))
        takers[0]()
    finally:
        is_over.append(True)
        _wait_for(at_work, done)
    if errors:
        raise errors[0]


def _wait_for(at_work: set[int], done: SimpleQueue[None]) -> None:
    """Block until no callable is running, even after Ctrl-C: the caller may then free the arrays that they write to,
    and the next launch uses the same scratch."""
    try:
        while at_work:
            done.get()
    except BaseException:
        _wait_for(at_work, done)
        raise


@cache
def _waiting(threads: int) -> SimpleQueue[Callable[[], None]]:
    """The queue of a pool of `threads` daemon threads; an idle one runs the next callable put on it.

    concurrent.futures is not used: an exception from a signal handler can leave its locks locked.
    """
    waiting: SimpleQueue[Callable[[], None]] = SimpleQueue()
    for k in range(threads):
        Thread(target=_run, args=(waiting,), name=f"rigcast_{k}", daemon=True).start()
    return waiting


def _run(waiting: SimpleQueue[Callable[[], None]]) -> NoReturn:
    while True:
        waiting.get()()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_waiting.cache_clear)  # threads stay with the parent
