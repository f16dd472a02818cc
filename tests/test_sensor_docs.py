"""docs/sensors.md: its code runs, its commands are there, and its pictures are those that the command makes."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

CHECKOUT = Path(__file__).resolve().parent.parent
TEXT = (CHECKOUT / "docs" / "sensors.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)
PICTURES = re.findall(r"!\[[^]]+\]\((sensors/[^)]+)\)", TEXT)


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the page finds in a clone, and its rig files, each by the name in its first line."""
    folder = tmp_path_factory.mktemp("clone")
    (folder / "configs").symlink_to(CHECKOUT / "configs")
    for kind, block in BLOCKS:
        if kind == "yaml":
            (folder / block.splitlines()[0].removeprefix("# ")).write_text(block)
    return folder


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for name in re.findall(r"examples/(\w+\.py) docs/sensors", (CHECKOUT / "Makefile").read_text()):
        script = CHECKOUT / "examples" / name
        subprocess.run([sys.executable, script, folder], check=True, capture_output=True, timeout=300)
    return folder


@pytest.mark.parametrize("code", [block for kind, block in BLOCKS if kind == "python"])
def test_the_python_runs(code: str, clone: Path) -> None:
    done = subprocess.run([sys.executable, "-c", code], cwd=clone, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()])
def test_commands_are_targets_of_the_makefile(command: str) -> None:
    program, target = command.split()
    assert program == "make"
    assert re.search(rf"^{target}:", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)


def test_every_picture_is_shown() -> None:
    kept = {f"sensors/{path.name}" for path in (CHECKOUT / "docs" / "sensors").iterdir()}
    assert set(PICTURES) == kept
    assert len(PICTURES) == len(kept)


@pytest.mark.parametrize("picture", PICTURES)
def test_a_picture_is_what_the_command_makes(picture: str, drawn: Path) -> None:
    """But for pixels whose noise another processor rounds otherwise."""
    kept, made = (
        np.asarray(Image.open(path).convert("RGB"), np.int16)
        for path in (CHECKOUT / "docs" / picture, drawn / Path(picture).name)
    )
    assert kept.shape == made.shape
    assert (np.abs(kept - made).max(axis=-1) > 8).mean() < 0.002
