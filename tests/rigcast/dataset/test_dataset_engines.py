"""Workers that are killed for real: what comes out is what an undisturbed run makes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rigcast.dataset.config import read_dataset
from rigcast.dataset.engines import Processes, Ray
from rigcast.sensors.errors import InputError

from .small_datasets import contents, controlled_by, make


@pytest.fixture
def unlucky(path: Path) -> Path:
    """The file of a data set one of whose workers is killed, half an episode into its work."""
    return controlled_by(path, "type: python, function: 'users_functions:unlucky'")


def undisturbed(path: Path) -> dict[str, bytes]:
    """What the data set is when nobody is killed any more."""
    assert (path.parent / "killed").exists(), "no worker was killed"
    make(path, "undisturbed")
    return contents(path.parent / "undisturbed")


def command(path: Path, engine: str) -> list[str]:
    """`rigcast dataset` into the folder `out` with two workers."""
    options = ["--out", str(path.parent / "out"), "--engine", engine, "--workers", "2", "--device", "cpu"]
    return [str(Path(sys.executable).parent / "rigcast"), "dataset", str(path), *options]


def test_processes_go_on_where_workers_were_killed(unlucky: Path) -> None:
    """One worker dies once, half an episode into its work; another episode kills its worker each time."""
    deadly = read_dataset(unlucky).units()[1]
    (unlucky.parent / "deadly").write_text(str(deadly.seed))
    done = make(unlucky, engine=Processes(2))
    (failure,) = done.manifest["failed"]
    assert (failure["scene"], failure["episode"]) == (deadly.scene, deadly.number)
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


def test_without_ray_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"the engine ray needs ray.*rigcast\[cluster\]"):
        Ray()
