"""Commands whose output cannot be written, is read by nobody, or goes to a closed stream."""

import errno
import io
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO

import pytest
from rich.console import Console

from rigcast.cli.common import ready


def run_main(*arguments: str, stdout: int | IO[bytes]) -> tuple[int, str]:
    """Exit code and standard error of a process of its own."""
    main = "import sys; from rigcast.cli import main; main()"
    command = [sys.executable, "-c", main, *arguments]
    done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False)
    return done.returncode, done.stderr


LONG_ANSWERS = (["--help"], ["schema"], ["presets"], ["presets", "velodyne_vlp16", "--json", "-"])


@pytest.mark.parametrize("arguments", LONG_ANSWERS, ids=" ".join)
def test_a_pipe_that_nobody_reads_ends_a_command_without_a_word(arguments: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    try:
        assert run_main(*arguments, stdout=write) == (141, "")
    finally:
        os.close(write)


def test_a_run_whose_words_nobody_reads_is_recorded_whole(rig: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    out = rig.parent / "out"
    try:
        outside = "sensors.top.mount.pos=[0, 0, 9]"  # outside the torso, about which a warning would be printed before
        code, _ = run_main("run", str(rig), "--device", "cpu", "--out", str(out), "--set", outside, stdout=write)
    finally:
        os.close(write)
    assert code == 141
    assert sorted(path.name for path in out.iterdir()) == ["frames.npz", "front", "ids.json", "top"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this machine")
@pytest.mark.parametrize("arguments", LONG_ANSWERS, ids=" ".join)
def test_a_full_disk_at_standard_output_is_told_in_one_line(arguments: list[str]) -> None:
    with Path("/dev/full").open("wb") as full:
        code, words = run_main(*arguments, stdout=full)
    assert (code, words) == (1, "standard output: cannot be written: No space left on device\n")


def run_redirected(redirection: str, *arguments: str) -> int:
    """Exit code of `python -m rigcast` with a redirection of the shell's."""
    command = ["sh", "-c", f'exec "$@" {redirection}', "sh", sys.executable, "-m", "rigcast", *arguments]
    return subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this machine")
@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-", "2>&- >&- <&-"])
@pytest.mark.parametrize("arguments", [["validate", "gone.yaml"], ["validat"], ["presets", "--bogus"]], ids=" ".join)
def test_words_that_cannot_be_told_change_no_exit_code(redirection: str, arguments: list[str]) -> None:
    assert run_redirected(redirection, *arguments) == 2


@pytest.mark.parametrize(("redirection", "code"), [("2>&-", 0), (">&-", 1), (">&- 2>&-", 1), ("<&-", 0)])
def test_a_stream_that_is_closed_is_told_apart_from_an_answer_that_is_lost(redirection: str, code: int) -> None:
    assert run_redirected(redirection, "presets", "--json", "-") == code


def test_letters_that_the_terminal_does_not_have_are_escaped(rig: Path) -> None:
    rig = rig.rename(rig.with_name("r\u00e4der.yaml"))
    command = [sys.executable, "-m", "rigcast", "validate", str(rig)]
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, env=ascii_only, check=False)
    assert done.returncode == 0, done.stderr
    assert b"r\\xe4der.yaml: valid, 2 sensors" in done.stdout


def test_no_file_takes_the_number_of_a_closed_stream() -> None:
    """Else the output of libraries would be written to that file."""
    opens = "import os; from rigcast.cli.common.streams import prepare_streams; prepare_streams()"
    opens += "; os._exit(os.open(os.devnull, os.O_WRONLY))"
    command = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", sys.executable, "-c", opens]
    assert subprocess.run(command, check=False).returncode > 2


class Refusing(io.StringIO):
    """A file that cannot be written."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number

    def write(self, _text: str) -> int:
        raise OSError(self.number, os.strerror(self.number))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EPIPE], ids=["a full disk", "a pipe that nobody reads"])
def test_a_word_of_compiling_that_cannot_be_written_is_left_out_and_the_next_one_is_missed(
    number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where nobody read on, it silenced all others, and the command ended with 0."""
    monkeypatch.setattr(ready, "_PATIENCE", 0.0)
    monkeypatch.setattr(Console, "on_broken_pipe", lambda _console: pytest.fail("of another thread"))
    before, console = set(threading.enumerate()), Console(file=Refusing(number))
    with ready.word_if_compiling(console):
        for thread in set(threading.enumerate()) - before:
            thread.join()
    assert capsys.readouterr().err == ""
    assert not console.quiet
