"""Every command and code block of the README and of docs/ works as written.

A page is worked through in a folder that has what a clone has: its YAML blocks are files by the names in their first
lines, a CSV block is rays.csv; then its commands run one after another, and its Python as one script.
"""

import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules

import pytest
from typer.testing import CliRunner

import rigcast
from rigcast.cli import app
from rigcast.export.options import Export
from rigcast.recording.formats import FORMATS
from rigcast.rig_file import open_rig
from rigcast.sensors.specs.presets import load_preset, preset_names

CHECKOUT = Path(__file__).resolve().parent.parent
PAGES = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
BLOCKS = {page.stem: re.findall(r"```(\w+)\n(.*?)```", page.read_text(), re.DOTALL) for page in PAGES}
COMMANDS = [
    (page, line) for page in BLOCKS for kind, block in BLOCKS[page] if kind == "sh" for line in block.splitlines()
]
OURS = [(page, line) for page, line in COMMANDS if line.startswith("rigcast")]
FILES = [
    (page, "rays.csv" if kind == "csv" else block.split()[1], block)
    for page in BLOCKS
    for kind, block in BLOCKS[page]
    if kind in ("yaml", "csv")
]
HEAVY = ("torch", "mujoco_warp")  # imported by some blocks, and not installed for every test run
RIGS = [(page, name) for page, name, block in FILES if re.search("^(sensors:$|extends: configs)", block, re.MULTILINE)]


def script(page: str) -> str:
    """All Python of a page, followed by calls of its tests."""
    code = "".join(block for kind, block in BLOCKS[page] if kind == "python")
    return code + "".join(f"{name}()\n" for name in re.findall(r"^def (test_\w+)\(", code, re.MULTILINE))


@pytest.fixture(scope="module")
def clone_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of each page."""
    folders: dict[str, Path] = {}

    def folder_of(page: str) -> Path:
        if page not in folders:
            folders[page] = tmp_path_factory.mktemp(page)
            (folders[page] / "configs").symlink_to(CHECKOUT / "configs")
            for where, name, block in FILES:
                if where == page:
                    (folders[page] / name).write_text(block)
        return folders[page]

    return folder_of


def test_the_readme_has_blocks_of_each_kind() -> None:
    assert {kind for kind, _ in BLOCKS["README"]} == {"sh", "python", "yaml"}


def test_every_block_is_of_a_kind_that_is_tried() -> None:
    kinds = {kind for blocks in BLOCKS.values() for kind, _ in blocks}
    assert kinds <= {"sh", "python", "yaml", "text", "csv"}


@pytest.mark.parametrize(("page", "name"), RIGS)
def test_a_rig_is_valid(page: str, name: str, clone_of: Callable[[str], Path]) -> None:
    open_rig(clone_of(page) / name)


@pytest.mark.parametrize("page", BLOCKS)
def test_the_commands_of_a_page_succeed_and_then_its_python(
    page: str, clone_of: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(clone_of(page))
    for command in [line for where, line in OURS if where == page]:
        done = CliRunner().invoke(app, shlex.split(command)[1:])
        assert done.exit_code == 0, f"{command}\n{done.output}{done.exception}"
    for module in HEAVY:
        if f"import {module}" in script(page) and find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    run = subprocess.run([sys.executable, "-c", script(page)], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("command", [line for _, line in COMMANDS if not line.startswith("rigcast")])
def test_other_commands_are_targets_of_the_makefile(command: str) -> None:
    program, target = command.split()
    assert program == "make"
    assert re.search(rf"^{target}:", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_and_pictures_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert missing == []


def test_every_format_and_setting_is_described() -> None:
    text = (CHECKOUT / "docs" / "exporting.md").read_text()
    rows = " ".join(line.split("|")[1] for line in text.splitlines() if line.startswith("| `"))
    assert set(FORMATS) <= set(re.findall(r"`(\w+)`", rows))
    (settings,) = (block for page, name, block in FILES if (page, name) == ("exporting", "export.yaml"))
    assert set(Export.model_fields) == set(re.findall(r"^  (\w+):", settings, re.MULTILINE))


def test_every_public_name_is_in_the_api_reference() -> None:
    described = re.findall(r"^::: rigcast\.(\w+)$", (CHECKOUT / "docs" / "api.md").read_text(), re.MULTILINE)
    assert sorted(described) == sorted(rigcast.__all__)


def test_no_public_name_is_that_of_a_module() -> None:
    """Importing that module would replace the name."""
    assert {module.name for module in iter_modules(rigcast.__path__)}.isdisjoint(rigcast.__all__)


def test_every_public_name_is_listed_once() -> None:
    assert rigcast.Lidar.__name__ in (names := dir(rigcast)), "also where it has been used"
    assert len(names) == len(set(names))


def test_the_readme_counts_the_figures_of_devices() -> None:
    presets = [load_preset(name) for name in preset_names()]
    cited = sum(len(preset.cited()) for preset in presets)
    assumed = sum(len(preset.stated() - preset.cited()) for preset in presets)
    not_found = sum(why.startswith("not found") for preset in presets for why in preset.assumed.values())
    said = " ".join(PAGES[0].read_text().split())
    assert f"{len(presets)} presets" in said
    assert f"{cited} figures are cited" in said
    assert f"{assumed} are assumed and marked so on the device's card, {not_found} of them" in said
