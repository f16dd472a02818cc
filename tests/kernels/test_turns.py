"""What threads take of what is to be done: all of it, once."""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type"

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event
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
    busy, is_over = ThreadPoolExecutor(1), Event()
    monkeypatch.setattr(slices, "_threads", lambda _: busy)
    busy.submit(is_over.wait)
    counted = Counted(1000)
    counted.launch()
    is_over.set()
    busy.shutdown()
    np.testing.assert_array_equal(counted.times.numpy(), 1)
    np.testing.assert_array_equal(counted.by.numpy(), 0)
