"""A world moved far from the origin gives the same ranges, points, depths and normals to 1e-5 m."""

import copy

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
import scenes

import rigcast
from rigcast import DepthCamera, HeightScan, Lidar, Mount, Rig

FAR = [(1e4, 0, 0), (-7e3, 7e3, 1e3), (1e5, -1e5, 0)]
Floats = npt.NDArray[np.float64]


def moved(model: mujoco.MjModel, data: mujoco.MjData, by: Floats) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the model and state with everything shifted by a vector [m]."""
    there = copy.copy(model)
    there.geom_pos[model.geom_bodyid == 0] += by
    outer = np.flatnonzero(model.body_parentid == 0)[1:]
    there.body_pos[outer] += by
    posed = mujoco.MjData(there)
    posed.qpos[:] = data.qpos
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        start = model.jnt_qposadr[joint]
        posed.qpos[start : start + 3] += by
    mujoco.mj_kinematics(there, posed)
    return there, posed


def assert_same(there: npt.NDArray[np.floating], here: npt.NDArray[np.floating], what: str) -> None:
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-5, equal_nan=True, err_msg=what)


@pytest.mark.parametrize("by", FAR, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_a_cast_is_the_same_far_from_the_origin(seed: int, by: tuple[float, float, float]) -> None:
    model = scenes.scene(seed)
    data = scenes.state(model, seed, 1)
    origins, directions = scenes.rays(model, data, seed, 1, "towards")
    there, posed = moved(model, data, np.array(by))
    answers = []
    for of, state, offset in ((model, data, 0), (there, posed, np.array(by))):
        scene = rigcast.Scene(of)
        scene.update(state)
        answers.append(scene.cast(origins + offset, directions).numpy())
    here, far = answers
    assert (here.geom_id >= 0).mean() > 0.5
    np.testing.assert_array_equal(far.geom_id, here.geom_id, err_msg=f"seed {seed}")
    assert_same(far.distance, here.distance, f"seed {seed}, distance")
    assert_same(far.normal, here.normal, f"seed {seed}, normal")


def sensors(offset: Floats) -> list[Lidar | DepthCamera | HeightScan]:
    """Return one sensor of each type, on the world or on a moving body."""
    fixed = tuple((offset + np.array((0.1, 0.2, 3.5))).tolist())
    return [
        Lidar(name="own", mount=Mount(body="b0"), elevation_deg=[-30, -10, 5, 20], columns=90),
        Lidar(name="world", mount=Mount(pos=fixed), elevation_deg=[-60, -30], columns=60, max_range=20.0),
        DepthCamera(name="eye", mount=Mount(pos=fixed, euler_deg=(0, 80, 0)), resolution=(24, 18), fov_y_deg=90.0),
        HeightScan(name="feet", mount=Mount(pos=fixed), size=(4.0, 4.0), spacing=0.25),
    ]


@pytest.mark.parametrize("by", FAR, ids=str)
def test_sensors_read_the_same_far_from_the_origin(by: tuple[float, float, float]) -> None:
    offset = np.array(by)
    model = scenes.scene(1)
    data = scenes.state(model, 1, 1)
    there, posed = moved(model, data, offset)
    here = Rig(model, sensors(np.zeros(3))).sense(data)
    far = Rig(there, sensors(offset)).sense(posed)
    for name, frame in here.items():
        assert np.isfinite(frame.range.numpy()).mean() > 0.2, f"{name} sees too little to prove anything"
        np.testing.assert_array_equal(far[name].geom_id.numpy(), frame.geom_id.numpy(), err_msg=name)
        for field in ("range", "points", "normal", *(("depth",) if name == "eye" else ())):
            assert_same(getattr(far[name], field).numpy(), getattr(frame, field).numpy(), f"{name} {field}")
        assert_same(far[name].points_world.numpy() - offset, frame.points_world.numpy(), f"{name} points_world")
        assert far[name].points_world.numpy().dtype == np.float64
        assert_same(far[name].pose[:3, 3] - offset, frame.pose[:3, 3], f"{name} pose")
