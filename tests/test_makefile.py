"""Commands of the Makefile's targets: the demo installs rigcast alone, and links of other installs are kept."""

import shutil
import subprocess
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
BASE, DEV = "install --quiet --editable .", "install --quiet --editable '.[dev]'"


def would_run(target: str, clone: Path, *made: str) -> list[str]:
    """The commands of a target in a clone in which these files have been made."""
    for name in ("Makefile", "pyproject.toml"):
        shutil.copyfile(CHECKOUT / name, clone / name)
    for name in made:
        (clone / name).parent.mkdir(exist_ok=True)
        (clone / name).touch()
    done = subprocess.run(["make", "--dry-run", target], cwd=clone, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    ("target", "made", "installed"),
    [
        ("demo", [], [BASE]),
        ("demo", [".venv/base"], []),
        ("demo", [".venv/installed"], []),
        ("test", [], [DEV]),
        ("test", [".venv/base"], [DEV]),
        ("check", [".venv/base", ".venv/installed"], []),
    ],
)
def test_a_target_installs_what_it_needs(target: str, made: list[str], installed: list[str], tmp_path: Path) -> None:
    commands = would_run(target, tmp_path, *made)
    editable = [command.partition("-m pip ")[2] for command in commands if "--editable" in command]
    assert editable == installed


@pytest.mark.parametrize("target", ["check", "docs", "clean"])
def test_links_of_an_editable_install_stay(target: str, tmp_path: Path) -> None:
    removed = [word for line in would_run(target, tmp_path) if line.startswith("rm") for word in line.split()[2:]]
    assert {"build/lib", "build/installed"} <= set(removed)
    assert not any(Path("build/__editable__.rigcast").match(word) or word == "build" for word in removed)
