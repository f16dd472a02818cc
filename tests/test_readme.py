"""Every command and code block of the README and of docs/ works as it stands there."""

import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
PAGES = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
BLOCKS = {page.stem: re.findall(r"```(\w+)\n(.*?)```", page.read_text(), re.DOTALL) for page in PAGES}
COMMANDS = [
    (page, line) for page in BLOCKS for kind, block in BLOCKS[page] if kind == "sh" for line in block.splitlines()
]
OURS = [(page, line) for page, line in COMMANDS if line.startswith("rigcast")]
# What a block needs that is not among what the tests install.
NEEDS = {"python": "torch", "worlds": "mujoco_warp"}


@pytest.fixture(scope="module")
def clone_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """For each page a folder with what its commands find in a clone, and the rigs that the page has, by their names."""
    folders: dict[str, Path] = {}

    def folder_of(page: str) -> Path:
        if page not in folders:
            folders[page] = tmp_path_factory.mktemp(page)
            (folders[page] / "configs").symlink_to(CHECKOUT / "configs")
            for kind, block in BLOCKS[page]:
                if kind == "yaml":
                    (folders[page] / block.split()[1]).write_text(block)
        return folders[page]

    return folder_of


def test_the_readme_has_blocks_of_each_kind() -> None:
    assert {kind for kind, _ in BLOCKS["README"]} == {"sh", "python", "yaml"}


def test_every_block_is_of_a_kind_that_is_tried() -> None:
    kinds = {kind for blocks in BLOCKS.values() for kind, _ in blocks}
    assert kinds <= {"sh", "python", "yaml", "text", "csv"}


@pytest.mark.parametrize("page", BLOCKS)
def test_the_commands_succeed_one_after_another(page: str, clone_of: Callable[[str], Path]) -> None:
    for command in [line for where, line in OURS if where == page]:
        words = [str(Path(sys.executable).parent / "rigcast"), *shlex.split(command)[1:]]
        done = subprocess.run(words, cwd=clone_of(page), capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"


@pytest.mark.parametrize("command", [line for _, line in COMMANDS if not line.startswith("rigcast")])
def test_other_commands_are_targets_of_the_makefile(command: str) -> None:
    program, target = command.split()
    assert program == "make"
    assert re.search(rf"^{target}:", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)


@pytest.mark.parametrize("page", [page for page in BLOCKS if "python" in dict(BLOCKS[page])])
def test_the_python_of_a_page_runs_as_one_script(page: str, clone_of: Callable[[str], Path]) -> None:
    if page in NEEDS:
        pytest.importorskip(NEEDS[page])
    code = "".join(block for kind, block in BLOCKS[page] if kind == "python")
    done = subprocess.run([sys.executable, "-c", code], cwd=clone_of(page), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert missing == []
