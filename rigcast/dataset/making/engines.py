"""Engines that make episodes: in this process, in processes of this machine, or by Ray.

An engine takes a function and units and yields a result for each unit, in any order. Closing its generator
stops the work. A unit whose worker dies is retried alone, so that only units that kill their worker are given up.
"""

import multiprocessing
import os
import socket
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from threading import Thread
from typing import Any, Protocol

from rigcast.dataset.description.config import Unit
from rigcast.kernels.launching.slices import cpu_count
from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.threads import set_threads

from .episode import Result

Make = Callable[[Unit], Result]
Results = Generator[Result, None, None]

_RETRIES = 2  # retries of an episode whose worker died, in Ray
_PATIENCE = 5.0  # s, for a cluster's answer; Ray itself tries for minutes
_DIED = "its worker died, and died again when it was tried alone: killed, or out of memory"


class Engine(Protocol):
    """Makes episodes. workers: number of episodes made at a time."""

    workers: int

    def run(self, make: Make, units: Sequence[Unit]) -> Results:
        """Yield the result of each unit when it is done."""


class InProcess:
    """One episode after another, in this process, which may use all its CPUs for each."""

    workers = 1

    def run(self, make: Make, units: Sequence[Unit]) -> Results:
        yield from map(make, units)


class Processes:
    """Processes of this machine, each with its share of the CPUs."""

    def __init__(self, workers: int | None) -> None:
        self.workers = workers or cpu_count()

    def run(self, make: Make, units: Sequence[Unit]) -> Results:
        waiting, suspects = deque(units), list[Unit]()
        while waiting:
            running: dict[Future[Result], Unit] = {}
            try:
                with _pool(self.workers) as pool:
                    yield from _results(pool, self.workers, make, waiting, running)
            except BrokenProcessPool:
                suspects += running.values()
        for unit in suspects:
            yield _alone(make, unit)


def _results(
    pool: ProcessPoolExecutor, most: int, make: Make, waiting: deque[Unit], running: dict[Future[Result], Unit]
) -> Iterator[Result]:
    """Yield the results of the waiting units; those under way are in `running`."""
    while waiting or running:
        while waiting and len(running) < most:
            running[pool.submit(make, waiting[0])] = waiting[0]
            waiting.popleft()
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            result = future.result()
            del running[future]
            yield result


def _alone(make: Make, unit: Unit) -> Result:
    try:
        with _pool(1) as pool:
            return pool.submit(make, unit).result()
    except BrokenProcessPool:
        return Result(unit, _DIED)


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of fresh interpreters, because a fork of a process with Warp's and MuJoCo's threads may hang."""
    before = set(multiprocessing.active_children())
    threads = max(1, cpu_count() // workers)
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin, (threads,))
    try:
        yield pool
    except BaseException:  # do not wait for episodes whose results are no longer wanted
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(threads: int) -> None:
    """Initialise a worker process, which ends with the process that started it, however that ends."""
    set_threads(threads)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


class Ray:
    """Workers of a Ray cluster, or of one that is started on this machine and stopped at the end.

    All machines must see the data set's files and folder under the same paths.

    Args:
        address: of the cluster; "auto" for the one that this machine belongs to; None starts one.
        workers: one CPU each; None: as many as the cluster has CPUs when it is joined.

    Raises:
        InputError: Ray is not installed or does not start, or there is no cluster at the address, or one of other
            versions or with a token that is not known here.
    """

    def __init__(self, address: str | None = None, workers: int | None = None) -> None:
        # Ray reads it when it is imported, and tries without end, by default, what does not fit into memory
        os.environ.setdefault("RAY_task_oom_retries", str(_RETRIES))
        self._ray: Any = load_extra("the engine ray", "ray", "cluster")
        how: dict[str, Any] = {"address": address}
        if address is None:
            # "local", as Ray would join a cluster that runs on this machine; a small store, as nothing passes through
            # it but results of some hundred bytes each
            how = {"address": "local", "num_cpus": workers or cpu_count(), "object_store_memory": 200e6}
            how["include_dashboard"] = False
        else:
            _require_answer(address)
        try:
            self._ray.init(log_to_driver=False, logging_level="error", **how)
        except (OSError, RuntimeError, ValueError, self._ray.exceptions.RayError) as error:
            what = "Ray does not start" if address is None else f"--address: no Ray cluster at {address!r} to join"
            raise InputError(f"{what}: {str(error).strip()}") from None
        self.workers = workers or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        # twice as many as are made at a time, so that the next one is there when one is done; of a cluster of others no
        # more than `workers`, as its CPUs would make them all at a time
        self._most = workers if workers and address else 2 * self.workers

    def run(self, make: Make, units: Sequence[Unit]) -> Results:
        remote = self._ray.remote(num_cpus=1, max_retries=_RETRIES)(_with_one_thread)
        waiting, running = deque(units), dict[Any, Unit]()
        try:
            while waiting or running:
                while waiting and len(running) < self._most:
                    running[remote.remote(make, waiting[0])] = waiting[0]
                    waiting.popleft()
                (done, *_), _ = self._ray.wait(list(running), num_returns=1)
                yield self._result(done, running.pop(done))
        finally:
            self._ray.shutdown()

    def _result(self, done: Any, unit: Unit) -> Result:
        errors = self._ray.exceptions
        try:
            return self._ray.get(done)
        except (errors.WorkerCrashedError, errors.NodeDiedError, errors.OutOfMemoryError):
            return Result(unit, "its worker died three times: killed, out of memory, or with its machine")
        except errors.RayError as error:  # for example, a machine where rigcast cannot be imported
            return Result(unit, f"Ray: {str(error).strip().splitlines()[-1]}", stops=True)


def _require_answer(address: str) -> None:
    """Raise InputError if nothing listens at `host:port`. Without a port, Ray itself reports the mistake at once."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not port.isdecimal():
        return
    if not 1 <= int(port) <= 65535:
        raise InputError(f"--address: got {address!r}, expected a port from 1 to 65535")
    try:
        socket.create_connection((host.strip("[]"), int(port)), _PATIENCE).close()
    except OSError as error:
        raise InputError(f"--address: no Ray cluster at {address!r} to join: {error.strerror or error}") from None


def _with_one_thread(make: Make, unit: Unit) -> Result:
    set_threads(1)
    return make(unit)
