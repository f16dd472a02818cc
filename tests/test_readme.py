"""Every command and code block of the README works as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", (CHECKOUT / "README.md").read_text(), re.DOTALL)
COMMANDS = [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()]


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the README's commands find in a clone, and its rig file."""
    folder = tmp_path_factory.mktemp("clone")
    (folder / "configs").symlink_to(CHECKOUT / "configs")
    (rig,) = (block for kind, block in BLOCKS if kind == "yaml")
    (folder / "rig.yaml").write_text(rig)
    return folder


def test_the_readme_has_blocks_of_each_kind() -> None:
    assert {kind for kind, _ in BLOCKS} == {"sh", "python", "yaml"}


@pytest.mark.parametrize("command", [line for line in COMMANDS if line.startswith("rigcast")])
def test_a_command_succeeds(command: str, clone: Path) -> None:
    words = [str(Path(sys.executable).parent / "rigcast"), *command.split()[1:]]
    done = subprocess.run(words, cwd=clone, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("command", [line for line in COMMANDS if not line.startswith("rigcast")])
def test_other_commands_are_targets_of_the_makefile(command: str) -> None:
    program, target = command.split()
    assert program == "make"
    assert re.search(rf"^{target}:", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)


def test_the_python_runs(clone: Path) -> None:
    (code,) = (block for kind, block in BLOCKS if kind == "python")
    done = subprocess.run([sys.executable, "-c", code], cwd=clone, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
