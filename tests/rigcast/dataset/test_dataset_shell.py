"""`rigcast dataset` from the shell."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigcast.cli import app

from .small_datasets import contents, edited


@pytest.fixture(autouse=True)
def folder(path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, as the default output is relative."""
    monkeypatch.chdir(path.parent)
    return path.parent


def call(*arguments: str) -> tuple[int, str]:
    """Exit code and everything printed, on one line."""
    result = CliRunner().invoke(app, ["dataset", "set.yaml", *arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, " ".join(result.output.split())


def test_a_data_set_is_made_told_about_and_verified(folder: Path, whole: dict[str, bytes]) -> None:
    code, output = call("--device", "cpu")
    assert code == 0, output
    assert "4 of 4 episodes to make, 1 at a time" in output
    assert "4 of 4 episodes" in output
    assert "0 failed, 0 not made yet" in output
    assert "frames/s" in output
    assert "the limit is" in output
    assert "s left" in output
    assert contents(folder / "out/set") == whole
    code, output = call("--verify")
    assert (code, "all as they were written" in output) == (0, True)
    (folder / "out/set/room/000000/ids.json").write_text("{}")
    code, output = call("--verify")
    assert (code, "1 wrong" in output) == (1, True)


def test_parts_of_an_array_job_make_the_whole(folder: Path, whole: dict[str, bytes]) -> None:
    code, output = call("--device", "cpu", "--shard", "2/2")
    assert (code, "2 of 2 episodes to make" in output, "2 not made yet" in output) == (0, True, True)
    assert call("--device", "cpu", "--shard", "1/2")[0] == 0
    assert contents(folder / "out/set") == whole
    code, output = call("--device", "cpu")
    assert (code, "0 of 4 episodes to make" in output) == (0, True)


def test_a_shard_without_its_entry_is_told(folder: Path) -> None:
    shard = folder / "out/set/room/000001"
    shard.mkdir(parents=True)
    (shard / "frames.npz").write_text("half")
    code, output = call("--device", "cpu")
    assert (code, output.count("has no entry.json")) == (0, 1), output
    assert "room/000001: has no entry.json" in output
    assert "has no entry.json" not in call("--device", "cpu")[1]


def test_an_episode_that_fails_is_told_with_its_reason(folder: Path) -> None:
    edited(folder / "set.yaml", ":push", ":broken")
    code, output = call("--device", "cpu")
    assert code == 1
    assert output.count("failed: ") == 1, "four failed for one reason"
    assert "failed: room, episode 0 (seed" in output
    assert ") and 3 others: users_functions:broken: OSError: no weights" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--shard", "0/2"], "--shard: got 0/2, expected a part from 1/2 to 2/2"),
        (["--shard", "3/2"], "--shard: got 3/2, expected a part from 1/2 to 2/2"),
        (["--shard", "1/0"], "--shard: got '1/0', expected I/N, such as 1/8"),
        (["--shard", "half"], "--shard: got 'half', expected I/N, such as 1/8"),
        (["--workers", "4"], "--workers: got 4 with --engine in-process, expected processes or ray"),
        (["--set", "seed=-1"], "--set:1:6: seed: must be greater than or equal to 0"),
        (["--verify", "--out", "none"], "none/dataset.json: not the manifest of a data set: No such file or directory"),
    ],
)
def test_a_mistake_is_told(arguments: list[str], message: str) -> None:
    code, output = call(*arguments)
    assert (code, message in output) == (2, True), output
