"""What docs/patterns.md shows works as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from rigcast import load_rig

DOCS = Path(__file__).resolve().parent.parent / "docs"
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", (DOCS / "patterns.md").read_text(), re.DOTALL)
SENSORS, PRESET, RIG = (block for kind, block in BLOCKS if kind == "yaml")
(RAYS,) = (block for kind, block in BLOCKS if kind == "csv")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in {"rays.csv": RAYS, "my_lidar.yaml": PRESET, "rig.yaml": RIG, "all.yaml": SENSORS}.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_the_patterns_are_read(folder: Path) -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="0.1"/></worldbody></mujoco>')
    frames = load_rig(folder / "all.yaml", model).sense(mujoco.MjData(model))
    assert {name: frame.shape for name, frame in frames.items()} == {
        "spinning": (3, 1024),
        "planar": (1, 541),
        "single": (1, 1),
        "solid_state": (5, 120),
        "rosette": (10_000,),
        "own": (3,),
    }


def test_the_users_preset_is_found(folder: Path) -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="0.1"/></worldbody></mujoco>')
    (sensor,) = load_rig(folder / "rig.yaml", model).sensors
    assert (sensor.max_range, sensor.rate_hz) == (60, 20)


@pytest.mark.parametrize("command", [line for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()])
def test_a_command_succeeds(command: str, folder: Path) -> None:
    words = [str(Path(sys.executable).parent / "rigcast"), *command.split()[1:]]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def test_pictures_are_there() -> None:
    for name in re.findall(r"\]\((\S+\.png)\)", (DOCS / "patterns.md").read_text()):
        assert (DOCS / name).is_file()
