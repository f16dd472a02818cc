"""Launching kernels over many rays: on CUDA in one piece, on the CPU in slices over threads."""

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
"""Tiles that a thread takes at once, where it takes as many each time."""
RAYS_PER_RUN, RUNS_PER_SLICE = 1024, 128
"""To wake a thread takes as long as to read tens of thousands of rays."""


def launch_over_rays(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
    slice_size: int = RAYS_PER_SLICE,
) -> None:
    """Launch a kernel over rays 0..count-1, or what else. Its first argument is the index of the ray of thread 0.

    Every ray's result depends on that ray alone, so slices and threads do not show in it.
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
    """Launch a kernel for which there is so little to do that a thread takes a run of rays, but on CUDA one.

    Its first arguments are the index of the run of thread 0, and how many rays a run has; the last may have fewer.
    A thread of the CPU takes at least RUNS_PER_SLICE runs.
    """
    run = 1 if wp.get_device(device).is_cuda else RAYS_PER_RUN
    runs = -(-count // run)
    slice_size = max(RUNS_PER_SLICE, -(-runs // thread_count()))
    launch_over_rays(kernel, runs, [run, *inputs], outputs, device, slice_size)


def prepare_over_rays(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
    slice_size: int = RAYS_PER_SLICE,
) -> Callable[[], object]:
    """`launch_over_rays`, to be called again and again; it reads what structs among the arguments hold by then.

    Of one slice the arguments are packed only now, which takes longer than a kernel needs for a few rays.
    """
    if count and (wp.get_device(device).is_cuda or count <= slice_size):
        return recorded(kernel, count, [0, *inputs], outputs, device)
    return partial(launch_over_rays, kernel, count, inputs, outputs, device, slice_size)


class OverTiles:
    """A launch of a CPU kernel over tiles 0..count-1, to be made again and again: once in each thread, to take tiles
    until none are left, each some when it is done with its last, as rigcast.kernels.launching.turns says.

    Its first arguments are the number of a thread, and an array of one number that is 0 at first, how many turns or
    tiles were taken; then `inputs` for so many threads.
    """

    def __init__(self, kernel: wp.Kernel, count: int, inputs: Callable[[int], Sequence[Any]]) -> None:
        self.count = count
        self._kernel, self._inputs = kernel, inputs
        self._turns = wp.zeros(1, dtype=int, device="cpu")
        self._taken = self._turns.numpy()
        self._of_threads: list[Callable[[], None]] = []

    def begin(self, threads: int) -> list[Callable[[], None]]:
        """What so many threads are to call, any of them or all: no tile is taken yet."""
        if threads > len(self._of_threads):
            given = self._inputs(threads)
            self._of_threads = [recorded(self._kernel, 1, [k, self._turns, *given], [], "cpu") for k in range(threads)]
        self._taken[0] = 0
        return self._of_threads

    def __call__(self) -> None:
        self.launch_with([])

    def launch_with(self, others: Sequence["OverTiles"]) -> None:
        """Several at once: a thread goes on to the next when no tile of one is left, and each begins with another."""
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
    """What a thread is to call, from the first on and round again."""
    for k in range(first - len(begun), first):
        begun[k][thread]()


def thread_count() -> int:
    """CPU threads to build trees and cast with: RIGCAST_THREADS, or as many as this process may use."""
    wanted = os.environ.get("RIGCAST_THREADS")
    return int(wanted) if wanted else cpu_count()


def cpu_count() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _at_once(takers: Sequence[Callable[[], object]], threads: int) -> None:
    """Run these, each of which takes what is left until nothing is: the first here, the others in other threads, of so
    many. One that has not begun when the first is done would find nothing, and is not waited for."""
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
    """Until nobody is at work, after Ctrl-C, too: what they write to may be freed afterwards, and the next launch has
    the same scratch."""
    try:
        while at_work:
            done.get()
    except BaseException:
        _wait_for(at_work, done)
        raise


@cache
def _waiting(threads: int) -> SimpleQueue[Callable[[], None]]:
    """What so many threads of their own run as soon as one has nothing else to do.

    concurrent.futures has locks that an exception of a signal's handler can leave locked.
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
