"""The examples run, with short arguments, and print what they say."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"

# script, arguments, what it prints, and a bound for the number in it
RUNS = [
    (
        "map_from_lidar.py",
        ["--seconds", "0.3", "--picture", "map.png"],
        r"map\.png: (\d+) of 160000 cells",
        200,
        20_000,
    ),
    ("fuse_depth.py", ["--seconds", "0.1", "--path", "fused.ply"], r"fused\.ply: (\d+) points", 2_000, 600_000),
    (
        "clearance_of_rollouts.py",
        ["--plans", "8"],
        r"of 8 headings, 225 deg is best: soon never nearer than ([\d.]+) m",
        1.5,
        3.0,
    ),
    ("avoid_walls.py", ["--steps", "400"], r"400 steps without a hit, ([\d.]+) m", 0.2, 1.2),
    ("learn_with_torch.py", ["--rounds", "200"], r"after 200 rounds: ([\d.]+) m off", 0.0, 0.4),
    ("walk_many_worlds.py", ["--worlds", "4", "--steps", "20"], r"4 worlds, 20 steps: ([\d.]+) m/s", 0.05, 0.6),
    ("replace_rangefinders.py", ["--steps", "40"], r"40 steps: at most ([\d.]+) µm", 0.0, 10.0),
]
# What a script needs that is not among what the oldest MuJoCo is tested with, or that is too large.
NEEDS = {"learn_with_torch.py": "torch", "walk_many_worlds.py": "mujoco_warp"}


@pytest.mark.parametrize(("script", "arguments", "printed", "low", "high"), RUNS, ids=[run[0] for run in RUNS])
def test_an_example_does_its_job(
    script: str, arguments: list[str], printed: str, low: float, high: float, tmp_path: Path
) -> None:
    if script in NEEDS:
        pytest.importorskip(NEEDS[script])
    command = [sys.executable, str(EXAMPLES / script), *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = re.search(printed, done.stdout)
    assert found, done.stdout
    assert low < float(found[1]) < high or (low == 0 == float(found[1])), done.stdout
    assert all((tmp_path / name).stat().st_size > 500 for name in arguments if name.endswith((".png", ".ply")))


def test_every_example_is_tried() -> None:
    makers = {"make_warehouse_meshes.py"}  # made the meshes of the warehouse
    # of docs/sensors.md, `make pictures`
    pictures = {"lidar_effects.py", "lidar_weather.py", "motion_effects.py", "sensor_effects.py"}
    assert {path.name for path in EXAMPLES.glob("*.py")} - makers - pictures == {run[0] for run in RUNS}
