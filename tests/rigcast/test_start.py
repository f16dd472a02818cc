"""Start-up: modules are imported only when they are needed, and the garbage collector is paused."""

import gc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigcast.collector import paused_collector

HEAVY = ["numpy", "mujoco", "warp", "pydantic", "ruamel", "PIL", "trimesh", "OpenEXR", "rich"]
OF_NUMPY = ["numpy.ma"] if np.lib.NumpyVersion(np.__version__) >= "2.0.0" else []  # which NumPy 1 imports itself
EFFECTS = ["cameras.kinect_v1", "cameras.losses", "cameras.stereo", "cameras.time_of_flight"]
EFFECTS += ["lidars.beams", "lidars.ranging", "lidars.returns", "lidars.weather"]
RIG = """
import mujoco
from rigcast import DepthCamera, HeightScan, Lidar, Mount, Rig
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1 1 1' type='box'/></worldbody></mujoco>")
sensors = [
    Lidar(name="top", mount=Mount(pos=(0, 0, 2)), elevation_deg=[-60.0, -30.0], columns=8),
    DepthCamera(name="front", mount=Mount(pos=(-3, 0, 0)), resolution=(8, 6), fov_y_deg=50),
    HeightScan(name="feet", mount=Mount(pos=(0, 0, 2)), size=(1.0, 1.0), spacing=0.5),
]
frames = Rig(model, sensors, device="cpu").sense(mujoco.MjData(model))
assert [len(frame.points_world.numpy()) > 0 for frame in frames.values()] == [True] * 3
"""
NEEDLESS = {
    "rigcast": ("import rigcast", HEAVY),
    "the command line": ("import rigcast.cli", HEAVY),
    "the schema": ("import rigcast.cli.schema", ["warp", "PIL", "trimesh"]),
    "presets": ("import rigcast.cli.presets", ["warp", "trimesh"]),
    "a rig file": ("import rigcast.rig_file", ["warp", "PIL", "trimesh", "rich"]),
    "sensors without effects": (
        RIG,
        ["PIL", "trimesh", "rich", *OF_NUMPY, *(f"rigcast.kernels.effects.{name}" for name in EFFECTS)],
    ),
}


@pytest.mark.parametrize("what", NEEDLESS)
def test_nothing_is_imported_that_is_not_needed(what: str, tmp_path: Path) -> None:
    code, needless = NEEDLESS[what]
    found = f"\nimport sys\nprint('imported', [name for name in {needless} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code + found], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "imported []", what


@pytest.mark.parametrize("is_enabled", [True, False])
def test_the_collector_is_afterwards_as_it_was(is_enabled: bool) -> None:
    """Objects made while it was paused are in the oldest generation, and nothing is frozen."""
    was_enabled = gc.isenabled()
    try:
        (gc.enable if is_enabled else gc.disable)()
        with paused_collector():
            made: list[object] = [{}]
            assert not gc.isenabled()
        assert gc.isenabled() == is_enabled
        assert gc.get_freeze_count() == 0
        assert any(each is made for each in gc.get_objects(generation=2))
    finally:
        (gc.enable if was_enabled else gc.disable)()


def test_what_others_have_frozen_stays_frozen() -> None:
    """The collector sees none of it. Its number may change, as other threads release some."""
    made: list[object] = [{}]
    gc.freeze()
    try:
        with paused_collector():
            pass
        assert not any(each is made for each in gc.get_objects())
    finally:
        gc.unfreeze()
