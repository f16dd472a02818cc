"""What threads take of what is to be done: all of it, once."""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type"

import os
import signal
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from threading import Event
from time import sleep
from typing import Any

import numpy as np
import pytest
import warp as wp

from rigcast.kernels.launching import slices
from rigcast.kernels.launching.turns import LEAST, end_of_run, take_run

wp.set_module_options({"enable_backward": False})


@wp.kernel
def count_taken(thread: int, taken: wp.array[int], threads: int, times: wp.array[int], by: wp.array[int]) -> None:
    count = times.shape[0]
    begin = take_run(taken, count, threads)
    while begin < count:
        for i in range(begin, end_of_run(begin, count, threads)):
            times[i] += 1
            by[i] = thread
        begin = take_run(taken, count, threads)


class Counted:
    """A launch over so many items, and how often each was taken, and by which thread."""

    def __init__(self, count: int) -> None:
        self.times, self.by = (wp.zeros(count, dtype=int, device="cpu") for _ in range(2))
        self.launch = slices.OverTiles(count_taken, count, self._inputs)

    def _inputs(self, threads: int) -> Sequence[Any]:
        return [threads, self.times, self.by]


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("count", [1, LEAST, 16 * LEAST + 1, 100_003])
def test_all_is_taken_once_however_often_it_is_launched(
    monkeypatch: pytest.MonkeyPatch, count: int, threads: int
) -> None:
    monkeypatch.setenv("RIGCAST_THREADS", str(threads))
    counted = Counted(count)
    for again in range(1, 4):
        counted.launch()
        np.testing.assert_array_equal(counted.times.numpy(), again)


def test_a_thread_that_has_not_begun_when_all_is_taken_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIGCAST_THREADS", "2")
    waiting: SimpleQueue[Callable[[], None]] = SimpleQueue()
    monkeypatch.setattr(slices, "_waiting", lambda _: waiting)
    counted = Counted(1000)
    counted.launch()
    waiting.get()()  # too late
    np.testing.assert_array_equal(counted.times.numpy(), 1)
    np.testing.assert_array_equal(counted.by.numpy(), 0)


def test_an_interrupted_launch_waits_for_its_other_threads() -> None:
    begun, done = Event(), list[str]()

    def interrupted() -> None:
        begun.wait()
        raise KeyboardInterrupt

    def other() -> None:
        begun.set()
        sleep(0.1)
        done.append("other")

    with pytest.raises(KeyboardInterrupt):
        slices._at_once([interrupted, other], 2)
    assert done == ["other"]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("presses", [1, 3])
def test_ctrl_c_while_it_waits_for_its_other_threads_does_not_end_that(presses: int) -> None:
    """The arrays that they wrote to were freed meanwhile, which ended the process."""
    begun, done = Event(), list[str]()

    def other() -> None:
        begun.set()
        sleep(0.05)  # by now the first thread waits for this one
        for _ in range(presses):
            os.kill(os.getpid(), signal.SIGINT)
            sleep(0.05)
        done.append("other")

    with pytest.raises(KeyboardInterrupt):
        slices._at_once([begun.wait, other], 2)
    assert done == ["other"]


def test_what_another_thread_raises_is_raised() -> None:
    begun = Event()

    def failing() -> None:
        begun.set()
        raise ValueError("of a thread")

    with pytest.raises(ValueError, match="of a thread"):
        slices._at_once([begun.wait, failing], 2)
