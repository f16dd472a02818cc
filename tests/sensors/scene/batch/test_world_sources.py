"""All sources of poses of many worlds are read like a list of MjData, at their present poses."""

import gc
import weakref
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from world_states import COUNT, ON_EACH, arrays_of, assert_same, fields_of, on_device, rig_of, states

from rigcast import InputError, Rig, Worlds


def test_worlds_that_are_made_once_follow_their_data(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    known, once, anew = Worlds(datas), rig_of(robot), rig_of(robot)
    for _ in range(2):
        frames, expected = once.sense(known), anew.sense(datas)
        for name in frames:
            assert_same(frames[name], expected[name], "made once")
        for data in datas[::2]:
            mujoco.mj_resetData(robot, data)
            data.qpos[:7] += 0.3
            mujoco.mj_forward(robot, data)
    with pytest.raises(InputError, match=r"batch\[0\] belongs to another model than the rig"):
        Rig(mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"), []).sense(known)


def test_lists_that_are_told_again_are_read_where_they_are_now(
    robot: mujoco.MjModel, datas: list[mujoco.MjData]
) -> None:
    """A rig remembers the addresses of each MjData's poses between readings; another list must not get those."""
    rig, others = rig_of(robot, "scan", "lidar"), states(robot, COUNT, seed=1)
    mixed = [datas[0], others[1], *datas[2:]]
    for given in (datas, mixed, datas[::-1], datas[:2], datas):
        expected = rig_of(robot, "scan", "lidar").sense(arrays_of(given))
        for name, frame in rig.sense(given).items():
            np.testing.assert_array_equal(frame.points_world.numpy(), expected[name].points_world.numpy())


def test_data_that_were_read_are_not_kept(robot: mujoco.MjModel) -> None:
    datas = states(robot, 2)
    alive = [weakref.ref(data) for data in datas]
    rig = rig_of(robot, "scan")
    frames = rig.sense(datas)
    del datas
    gc.collect()
    assert [data() for data in alive] == [None, None]
    assert rig.sense(states(robot, 2))["scan"].range.shape == frames["scan"].range.shape


def plain(datas: list[mujoco.MjData], _device: str) -> Any:
    return arrays_of(datas)


def nested(datas: list[mujoco.MjData], _device: str) -> Any:
    """Poses with rotations as 3 x 3 matrices and positions as nested lists."""
    arrays: dict[str, Any] = arrays_of(datas)
    for name, values in arrays.items():
        arrays[name] = values.reshape(*values.shape[:2], 3, 3) if name.endswith("xmat") else values.tolist()
    return arrays


@ON_EACH
@pytest.mark.parametrize("batch", [plain, nested, on_device])
def test_arrays_of_poses_read_as_a_list_of_data_does(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], batch: Any, device: str
) -> None:
    frames = rig_of(robot, device=device).sense(batch(datas, device))
    for name, frame in rig_of(robot, device=device).sense(datas).items():
        assert_same(frames[name], frame, batch.__name__)


def test_time_is_zero_where_it_is_not_given(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    frame = rig_of(robot, "lidar").sense(arrays_of(datas, ("geom_xpos", "geom_xmat", "xpos", "xmat")))["lidar"]
    np.testing.assert_array_equal(fields_of(frame)["time"], np.zeros(COUNT))


def test_a_batch_of_mujoco_reads_as_a_list_of_data_does(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    module = pytest.importorskip("mujoco.batch", reason="from MuJoCo 4.0 on")
    batch, rig = module.Batch(robot, COUNT), rig_of(robot)
    batch.qpos, batch.time = np.array([d.qpos for d in datas]), np.array([d.time for d in datas])
    with pytest.raises(InputError, match=r"xmat of world 0 has not been computed .* batch\.forward\(\)"):
        rig.sense(batch)
    for name in ("xmat", "site_xmat", "cam_xmat"):
        batch.bind(name)
        batch.bind(name.replace("mat", "pos"))
    batch.forward()
    frames = rig.sense(batch)
    for name, frame in rig_of(robot).sense(datas).items():
        assert_same(frames[name], frame, "mujoco.batch")


def test_sizes_of_a_batch_of_mujoco_count(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    module = pytest.importorskip("mujoco.batch", reason="from MuJoCo 4.0 on")
    batch, rig = module.Batch(robot, COUNT), rig_of(robot, "lidar")
    batch.qpos = np.array([d.qpos for d in datas])
    for name in ("geom_xpos", "geom_xmat", "xpos", "xmat"):
        batch.bind(name)
    batch.forward()
    batch.expand("geom_size")[1, robot.geom("ball").id] = 9.0
    got = rig.sense(batch)["lidar"]
    expected = rig_of(robot, "lidar").sense(Worlds(datas, geom_size=batch.expanded("geom_size")))["lidar"]
    np.testing.assert_array_equal(got.range.numpy(), expected.range.numpy())
    same = rig_of(robot, "lidar").sense(datas)["lidar"].range.numpy()
    assert (got.range.numpy() != same).any(axis=(1, 2)).tolist() == [False, True, False, False]


def warp_data(robot: mujoco.MjModel, datas: list[mujoco.MjData], device: str) -> Any:
    """A mujoco_warp Data with these poses."""
    mjw = pytest.importorskip("mujoco_warp")
    with wp.ScopedDevice(device):
        data = mjw.put_data(robot, datas[0], nworld=len(datas))
    for name, values in arrays_of(datas).items():
        getattr(data, name).assign(values.astype(np.float32).reshape(getattr(data, name).numpy().shape))
    return data


def rounded(datas: list[mujoco.MjData]) -> dict[str, np.ndarray]:
    """Poses rounded to float32."""
    return {name: values.astype(np.float32) for name, values in arrays_of(datas).items()}


@ON_EACH
def test_a_mujoco_warp_data_reads_as_its_poses_do(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], device: str
) -> None:
    data, rig = warp_data(robot, datas, device), rig_of(robot, device=device)
    frames = rig.sense(data)
    for name, frame in rig_of(robot, device=device).sense(rounded(datas)).items():
        assert_same(frames[name], frame, "mujoco_warp")
    # in place: what a step writes into its arrays is what the next reading sees
    for name, values in rounded(datas[::-1]).items():
        getattr(data, name).assign(values.reshape(getattr(data, name).numpy().shape))
    kept = fields_of(frames["lidar"])
    backwards = rig_of(robot, "lidar", device=device).sense(rounded(datas[::-1]))["lidar"]
    assert_same(rig.sense(data)["lidar"], backwards, "mujoco_warp, moved on")
    for name, values in kept.items():
        np.testing.assert_array_equal(fields_of(frames["lidar"])[name], values, err_msg=f"a frame changed: {name}")


@ON_EACH
def test_poses_of_a_device_are_used_in_place(robot: mujoco.MjModel, datas: list[mujoco.MjData], device: str) -> None:
    data, rig = warp_data(robot, datas, device), rig_of(robot, "lidar", device=device)
    rig.sense(data)
    geometry = rig.scene._world.geometry
    assert (geometry.position_float.ptr, geometry.rotation_float.ptr) == (data.geom_xpos.ptr, data.geom_xmat.ptr)
