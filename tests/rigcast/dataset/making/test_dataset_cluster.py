"""A Ray cluster of two machines, of which one is lost during a run."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from small_datasets import SECOND_MACHINE, contents, controlled_by, make

BIN = Path(sys.executable).parent
OPEN = {**os.environ, "RAY_AUTH_MODE": "disabled"}  # a cluster without tokens
DEADLINE = 120.0


def start(*arguments: str, **environment: str) -> subprocess.Popen[str]:
    """A process of `ray start` that stands for a machine; it blocks until it is ended."""
    command = [str(BIN / "ray"), "start", "--block", "--num-cpus=1", "--object-store-memory=80000000", *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=OPEN | environment
    )


def wait_until_started(machine: subprocess.Popen[str]) -> None:
    assert machine.stdout is not None
    said = []
    for line in machine.stdout:
        said.append(line)
        if "Ray runtime started" in line:
            return
    raise AssertionError("".join(said))


@pytest.fixture
def cluster() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a cluster of two machines with a CPU each, and the second one."""
    pytest.importorskip("ray")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    folder = tempfile.mkdtemp(prefix="ray")  # short, as the paths of sockets in it may have at most 107 bytes
    machines = [start("--head", f"--port={port}", f"--temp-dir={folder}", "--include-dashboard=false")]
    try:
        wait_until_started(machines[0])
        machines.append(start(f"--address=127.0.0.1:{port}", **{SECOND_MACHINE: "1"}))
        wait_until_started(machines[1])
        yield f"127.0.0.1:{port}", machines[1]
    finally:
        for machine in machines[::-1]:
            machine.send_signal(signal.SIGTERM)
            machine.communicate(timeout=DEADLINE)
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.long  # a cluster takes a quarter of a minute to start
def test_ray_goes_on_where_a_machine_was_lost(path: Path, cluster: tuple[str, subprocess.Popen[str]]) -> None:
    address, second = cluster
    controlled_by(path, "type: python, function: 'users_functions:lost'")
    command = [str(BIN / "rigcast"), "dataset", str(path), "--out", str(path.parent / "out"), "--address", address]
    done = subprocess.run([*command, "--device", "cpu"], capture_output=True, text=True, timeout=300, env=OPEN)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 of 4 episodes to make, 2 at a time" in " ".join(done.stdout.split())
    assert (path.parent / "killed").exists(), "nothing was lost"
    second.wait(timeout=DEADLINE)
    make(path, "undisturbed")
    assert contents(path.parent / "out") == contents(path.parent / "undisturbed")
