"""Every command and code block of docs/exporting.md works as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from rigcast.config import open_rig
from rigcast.export.formats import FORMATS
from rigcast.export.options import Export

CHECKOUT = Path(__file__).resolve().parent.parent
TEXT = (CHECKOUT / "docs" / "exporting.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)


def blocks(kind: str) -> list[str]:
    return [block for other, block in BLOCKS if other == kind]


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the commands find in a clone."""
    folder = tmp_path_factory.mktemp("clone")
    (folder / "configs").symlink_to(CHECKOUT / "configs")
    return folder


@pytest.mark.parametrize("command", [line for block in blocks("sh") for line in block.splitlines()])
def test_a_command_succeeds(command: str, clone: Path) -> None:
    words = [str(Path(sys.executable).parent / "rigcast"), *command.split()[1:]]
    done = subprocess.run(words, cwd=clone, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_python_runs(clone: Path) -> None:
    (code,) = blocks("python")
    done = subprocess.run([sys.executable, "-c", code], cwd=clone, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[-1]) >= 1
    assert (clone / "out/python/rosbag2_mcap/metadata.yaml").is_file()


def test_the_yaml_is_part_of_a_rig(tmp_path: Path) -> None:
    classes, export = blocks("yaml")
    names = ("person", "visitor_1", "dolly", "left_finger", "right_finger")
    bodies = "".join(f"<body name='{name}'><geom size='0.1'/></body>" for name in names)
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    sensors = "sensors: [{name: a, type: lidar, mount: {}, elevation_deg: [0], columns: 4}]\n"
    (tmp_path / "rig.yaml").write_text("model: m.xml\n" + sensors + classes + export)
    config, _ = open_rig(tmp_path / "rig.yaml")
    assert list(config.classes) == ["person", "robot", "gripper"]
    assert config.export == Export()


def test_every_format_and_setting_is_described() -> None:
    rows = " ".join(line.split("|")[1] for line in TEXT.splitlines() if line.startswith("| `"))
    assert set(FORMATS) <= set(re.findall(r"`(\w+)`", rows))
    assert set(Export.model_fields) == set(re.findall(r"^  (\w+):", blocks("yaml")[1], re.MULTILINE))
