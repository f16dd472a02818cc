"""The demo scene has geoms of every kind, its robot drives, and its files are those that their script makes."""

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

CHECKOUT = Path(__file__).resolve().parents[2]
WAREHOUSE = CHECKOUT / "configs" / "warehouse"
MESHES = WAREHOUSE / "meshes"


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(WAREHOUSE / "warehouse.xml"))


@pytest.fixture(scope="module")
def drive(model: mujoco.MjModel) -> tuple[mujoco.MjData, NDArray[np.float64]]:
    """The state 3 s after the keyframe, and the robot's up axis in the world at every step."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("drive").id)
    up = []
    while data.time < 3.0:
        mujoco.mj_step(model, data)
        up.append(data.body("dolly").xmat.reshape(3, 3)[:, 2].copy())
    return data, np.array(up)


@pytest.mark.parametrize("kind", ["plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"])
def test_scene_has_every_kind_of_geom(model: mujoco.MjModel, kind: str) -> None:
    assert (model.geom_type == getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")).any()


def test_robot_drives_forward_and_stays_upright(
    model: mujoco.MjModel, drive: tuple[mujoco.MjData, NDArray[np.float64]]
) -> None:
    data, up = drive
    travelled = data.body("dolly").xpos - model.key("drive").qpos[:3]
    np.testing.assert_allclose(travelled, [3.0, 0.0, 0.17], atol=0.15)
    assert np.degrees(np.arccos(up[:, 2].min())) < 15.0


@pytest.mark.parametrize("joint", ["arm_yaw", "arm_elbow", "lift", "barrier", "door", "walk"])
def test_joint_moves(model: mujoco.MjModel, drive: tuple[mujoco.MjData, NDArray[np.float64]], joint: str) -> None:
    start = model.key("drive").qpos[model.joint(joint).qposadr[0]]
    assert abs(drive[0].joint(joint).qpos[0] - start) > 0.3


@pytest.mark.parametrize("box", ["tumbling_1", "tumbling_2", "tumbling_3"])
def test_box_falls_to_the_floor(drive: tuple[mujoco.MjData, NDArray[np.float64]], box: str) -> None:
    assert drive[0].body(box).xpos[2] < 0.4


def test_simulation_raises_no_mujoco_warning(drive: tuple[mujoco.MjData, NDArray[np.float64]]) -> None:
    raised = {mujoco.mjtWarning(i).name: w.number for i, w in enumerate(drive[0].warning) if w.number}
    assert not raised


def test_script_makes_the_files_of_the_scene(tmp_path: Path) -> None:
    script = CHECKOUT / "examples" / "make_warehouse_meshes.py"
    subprocess.run([sys.executable, script, tmp_path], check=True, capture_output=True)
    names = sorted(path.name for path in MESHES.iterdir())
    assert sorted(path.name for path in (tmp_path / "meshes").iterdir()) == names
    for name in names:
        made, kept = (contents(folder / name) for folder in (tmp_path / "meshes", MESHES))
        np.testing.assert_allclose(made, kept, atol=1e-6, err_msg=name)


def contents(path: Path) -> NDArray[np.float64]:
    """The pixels of an image file, or the triangles of a mesh file."""
    if path.suffix == ".png":
        return np.asarray(Image.open(path), dtype=np.float64)
    return np.asarray(trimesh.load_mesh(path).triangles)
