"""With workers that are really killed, the data set is that of an undisturbed run."""

import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from small_datasets import contents, controlled_by, edited, make

from rigcast.dataset.description.config import Unit, read_dataset
from rigcast.dataset.making import engines
from rigcast.dataset.making.engines import Processes, Ray
from rigcast.dataset.making.episode import Result
from rigcast.sensors.errors import InputError


@pytest.fixture
def unlucky(path: Path) -> Path:
    """The file of a data set of which one worker is killed once, in the middle of an episode."""
    return controlled_by(path, "type: python, function: 'users_functions:unlucky'")


def undisturbed(path: Path) -> dict[str, bytes]:
    """The data set made without a killed worker."""
    assert (path.parent / "killed").exists(), "no worker was killed"
    make(path, "undisturbed")
    return contents(path.parent / "undisturbed")


def command(path: Path, engine: str) -> list[str]:
    """The command `rigcast dataset` with two workers, which writes to the folder `out`."""
    options = ["--out", str(path.parent / "out"), "--engine", engine, "--workers", "2", "--device", "cpu"]
    return [str(Path(sys.executable).parent / "rigcast"), "dataset", str(path), *options]


def test_processes_go_on_where_workers_were_killed(unlucky: Path) -> None:
    """One worker is killed once, in the middle of an episode; another episode kills its worker each time."""
    deadly = read_dataset(unlucky).units()[1]
    (unlucky.parent / "deadly").write_text(str(deadly.seed))
    done = make(unlucky, engine=Processes(2))
    (failure,) = done.manifest["failed"]
    assert (failure["scene"], failure["episode"]) == (deadly.scene, deadly.episode)
    assert "its worker died" in failure["reason"]
    (unlucky.parent / "deadly").unlink()
    assert make(unlucky).episodes == 1
    assert contents(unlucky.parent / "out") == undisturbed(unlucky)


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_ended_at_any_moment_goes_on_from_there(
    path: Path, whole: dict[str, bytes], sent: signal.Signals
) -> None:
    with subprocess.Popen(
        command(path, "processes"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        deadline = time.monotonic() + 120
        while not list((path.parent / "out").glob("*/*/entry.json")):
            assert running.poll() is None, running.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        os.kill(running.pid, sent)
        running.communicate(timeout=60)
    assert running.returncode in {signal.SIGINT: (130, 0), signal.SIGKILL: (-signal.SIGKILL,)}[sent]
    make(path)
    assert contents(path.parent / "out") == whole


def test_ray_goes_on_where_a_worker_was_killed(unlucky: Path) -> None:
    pytest.importorskip("ray")
    done = subprocess.run(command(unlucky, "ray"), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 of 4 episodes to make, 2 at a time" in " ".join(done.stdout.split())
    assert contents(unlucky.parent / "out") == undisturbed(unlucky)


class FakeRay:
    """The part of Ray that the engine uses, on a cluster of 8 CPUs; every task ends with `error`, or with a result."""

    class exceptions:
        class RayError(Exception): ...

        class WorkerCrashedError(RayError): ...

        class NodeDiedError(RayError): ...

        class OutOfMemoryError(RayError): ...

    def __init__(self, error: str | None = None) -> None:
        self.error, self.most, self.shut_down = error, 0, False

    def init(self, **how: Any) -> None:
        self.how = how
        if str(how["address"]).startswith("127.0.0.1"):
            raise self.exceptions.RayError("Authentication token is missing")

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 8.0}

    def remote(self, **_needs: Any) -> Any:
        return lambda _function: SimpleNamespace(remote=lambda _make, unit: (unit,))

    def wait(self, running: list[Any], num_returns: int) -> tuple[list[Any], list[Any]]:
        self.most = max(self.most, len(running))
        return running[:num_returns], running[num_returns:]

    def get(self, task: tuple[Unit]) -> Result:
        if self.error is not None:
            raise getattr(self.exceptions, self.error)("a long story\nModuleNotFoundError: No module named 'rigcast'\n")
        return Result(*task)

    def shutdown(self) -> None:
        self.shut_down = True


@pytest.mark.parametrize(
    ("address", "workers", "most"), [(None, 3, 6), (None, None, 16), ("auto", 3, 3), ("auto", None, 16)]
)
def test_ray_is_asked_for_no_more_workers_than_it_shall_use(
    monkeypatch: pytest.MonkeyPatch, address: str | None, workers: int | None, most: int
) -> None:
    ray, units = FakeRay(), [Unit("room", k, k) for k in range(40)]
    monkeypatch.setattr(engines, "load_extra", lambda *_names: ray)
    made = list(Ray(address, workers).run(Result, units))
    assert [result.unit for result in made] == units
    assert (ray.most, ray.shut_down) == (most, True)


def test_ray_gives_up_what_never_fits_into_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray retries for ever by default, and reads the number of retries from the environment."""
    monkeypatch.setenv("RAY_task_oom_retries", "")
    monkeypatch.delenv("RAY_task_oom_retries")
    monkeypatch.setattr(engines, "load_extra", lambda *_names: FakeRay())
    Ray()
    assert os.environ["RAY_task_oom_retries"] == "2"  # noqa: SIM112  # Ray's name


def test_ray_starts_one_of_its_own_or_says_why_it_joins_none(monkeypatch: pytest.MonkeyPatch) -> None:
    ray = FakeRay()
    monkeypatch.setattr(engines, "load_extra", lambda *_names: ray)
    Ray()
    assert ray.how["address"] == "local", "else Ray joins a cluster that runs on this machine"
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = "{}:{}".format(*server.getsockname())
        with pytest.raises(InputError, match=f"--address: no Ray cluster at '{address}' to join: Authentication token"):
            Ray(address)


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("127.0.0.1:1", "Connection refused"),
        ("[::1]:1", ""),
        ("ray://127.0.0.1:1", "Connection refused"),
    ],
)
def test_where_nobody_answers_ray_is_not_asked(monkeypatch: pytest.MonkeyPatch, address: str, message: str) -> None:
    """Ray itself would try for minutes without a message."""
    ray = FakeRay()
    monkeypatch.setattr(engines, "load_extra", lambda *_names: ray)
    with pytest.raises(InputError) as caught:
        Ray(address)
    assert str(caught.value).startswith(f"--address: no Ray cluster at {address!r} to join: ")
    assert message in str(caught.value)
    assert not hasattr(ray, "how")


@pytest.mark.parametrize("port", ["0", "65536", "99999999999999999999"])
def test_a_port_that_there_is_not_is_refused(monkeypatch: pytest.MonkeyPatch, port: str) -> None:
    """Sockets take a port modulo 65536."""
    monkeypatch.setattr(engines, "load_extra", lambda *_names: FakeRay())
    with pytest.raises(InputError, match=f"^--address: got 'head:{port}', expected a port from 1 to 65535$"):
        Ray(f"head:{port}")


@pytest.mark.parametrize(
    ("error", "reason", "stops"),
    [
        ("WorkerCrashedError", "its worker died three times", False),
        ("NodeDiedError", "its worker died three times", False),
        ("OutOfMemoryError", "its worker died three times", False),
        ("RayError", "Ray: ModuleNotFoundError: No module named 'rigcast'", True),
    ],
)
def test_what_ray_could_not_make_is_told(monkeypatch: pytest.MonkeyPatch, error: str, reason: str, stops: bool) -> None:
    monkeypatch.setattr(engines, "load_extra", lambda *_names: FakeRay(error))
    (result,) = Ray("auto").run(Result, [Unit("room", 0, 0)])
    assert reason in str(result.failed)
    assert result.stops is stops


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read as Linux tells it")
def test_a_worker_s_memory_does_not_grow_with_its_episodes(path: Path) -> None:
    """An episode has five frames of 1.8 MB, so that one kept in memory would be noticed."""
    edited(path, '  - {name: made, python: "users_functions:room"}\n', "")
    edited(path, "count: 2", "count: 8")
    edited(path.parent / "rig.yaml", "elevation_deg: [-20, 0]", f"elevation_deg: {list(range(-16, 0))}")
    edited(path.parent / "rig.yaml", "columns: 36", "columns: 2048")
    peaks: list[int] = []

    def note(_result: Result) -> None:
        (worker,) = multiprocessing.active_children()
        status = Path(f"/proc/{worker.pid}/status").read_text()
        peaks.append(int(status.partition("VmHWM:")[2].split()[0]))

    make(path, engine=Processes(1), report=note)
    assert peaks[-1] - peaks[1] < 4000, f"kB after each episode: {peaks}"


def test_without_ray_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"the engine ray needs ray.*rigcast\[cluster\]"):
        Ray()
