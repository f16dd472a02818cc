"""Anything but a batch of worlds of the rig's model is refused; the error says what is wrong and where."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from small_scenes import Elsewhere
from world_states import COUNT, arrays_of, assert_same, rig_of

from rigcast import InputError, Lidar, Mount, Rig, Worlds

CLOTH = """
<mujoco><worldbody><geom size="1"/>
  <flexcomp name="cloth" type="grid" dim="2" count="3 3 1" spacing="1 1 1" radius="0.05"/>
</worldbody></mujoco>
"""

FAULTS: dict[str, tuple[Any, str]] = {
    "nothing": ([], "got no world, expected one or more"),
    "another thing in the list": ([3], r"batch\[0\]: got int, expected MjData"),
    "no poses": (
        {"xpos": np.zeros((2, 5, 3))},
        "expected 'geom_xpos' and 'geom_xmat', got no geom_xpos and no geom_xmat",
    ),
    "a name that is none": ({"geom_pos": 0}, "no field 'geom_pos', expected one of .*did you mean 'geom_xpos'"),
    "another number of geoms": (
        {"geom_xpos": np.zeros((2, 3, 3)), "geom_xmat": np.zeros((2, 3, 9))},
        r"geom_xpos: got shape \(2, 3, 3\), expected \(2, 8, 3\)",
    ),
    "text": (
        {"geom_xpos": np.full((2, 8, 3), "x"), "geom_xmat": np.zeros((2, 8, 9))},
        "geom_xpos: got an array of <U1",
    ),
    "nothing at all": (
        None,
        "Rig: data: got NoneType, expected MjData, or many worlds: a mujoco_warp Data, a list of MjData, a",
    ),
    "numbers": ({"geom_xpos": 1.0, "geom_xmat": 2.0}, r"geom_xpos: got 1.0, expected an array \(nworld, ngeom, 3\)"),
    "times of two axes": (
        {"geom_xpos": np.zeros((2, 8, 3)), "geom_xmat": np.ones((2, 8, 9)), "time": np.zeros((2, 2))},
        r"time: got shape \(2, 2\), expected \(2,\): one per world",
    ),
    "rotations that are nothing": (
        {"geom_xpos": np.zeros((2, 8, 3)), "geom_xmat": np.zeros((2, 8, 9))},
        "batch: geom_xmat of world 0 is all zeros, expected rotation matrices",
    ),
    "one on the host": (
        {"geom_xpos": wp.zeros((2, 8), dtype=wp.vec3, device="cpu"), "geom_xmat": np.zeros((2, 8, 9))},
        "geom_xpos, geom_xmat: got one on the host, expected both there or on the device",
    ),
    "two precisions": (
        {
            "geom_xpos": wp.zeros((2, 8), dtype=wp.vec3, device="cpu"),
            "geom_xmat": wp.zeros((2, 8), dtype=wp.mat33d, device="cpu"),
        },
        "geom_xpos, geom_xmat: got arrays of vec3f and mat33d, expected both in one precision",
    ),
    "vectors of whole numbers on the device": (
        {"geom_xpos": wp.zeros((2, 8), dtype=wp.vec3i, device="cpu"), "geom_xmat": np.zeros((2, 8, 9))},
        r"geom_xpos: got an array \(2, 8\) of vec3i, expected \(2, 8\) of vec3f or vec3d",
    ),
    "another number of geoms on the device": (
        {"geom_xpos": wp.zeros((2, 7), dtype=wp.vec3, device="cpu"), "geom_xmat": np.zeros((2, 8, 9))},
        r"geom_xpos: got an array \(2, 7\) of vec3f, expected \(2, 8\) of vec3f or vec3d",
    ),
    "every second world on the device": (
        {
            "geom_xpos": wp.zeros((4, 8), dtype=wp.vec3, device="cpu")[::2],
            "geom_xmat": wp.zeros((2, 8), dtype=wp.mat33, device="cpu"),
        },
        r"geom_xpos: got an array with gaps, expected one without, as its contiguous\(\) is",
    ),
    "a tensor elsewhere": ({"geom_xpos": Elsewhere(), "geom_xmat": np.zeros((2, 8, 9))}, "geom_xpos: .* cuda:0"),
}


@pytest.mark.parametrize(("batch", "message"), FAULTS.values(), ids=list(FAULTS))
def test_what_is_no_batch_is_refused(robot: mujoco.MjModel, batch: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        rig_of(robot, "fixed").sense(batch)


def test_one_mjdata_is_no_batch(datas: list[mujoco.MjData]) -> None:
    with pytest.raises(InputError, match="batch: got MjData, expected a mujoco_warp Data, a list of MjData"):
        Worlds(datas[0])


def test_data_of_another_model_is_refused_by_its_place(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    other = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(InputError, match=r"batch\[2\] belongs to another model than the rig"):
        rig_of(robot, "fixed").sense([*datas[:2], mujoco.MjData(other)])


def test_a_world_that_was_never_worked_out_is_told(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    new = mujoco.MjData(robot)
    with pytest.raises(InputError, match="geom_xmat of world 2 has not been computed, expected mj_forward or"):
        rig_of(robot, "lidar").sense([*datas[:2], new])
    frame = rig_of(robot, "lidar").sense(Worlds([*datas[:2], new], active=[True, True, False]))["lidar"]
    expected = rig_of(robot, "lidar").sense(datas[:2])["lidar"]
    for world in range(2):
        assert_same(frame.world(world), expected.world(world), f"world {world}")
    assert np.isnan(frame.range.numpy()[2]).all()


def test_poses_that_a_mount_needs_are_asked_for(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    arrays = arrays_of(datas, ("geom_xpos", "geom_xmat", "xpos", "xmat"))
    with pytest.raises(InputError, match="no 'cam_xpos', which says where a sensor or prop on a camera is"):
        rig_of(robot, "lidar", "camera").sense(arrays)


def test_models_with_flexes_are_refused() -> None:
    cloth = mujoco.MjModel.from_xml_string(CLOTH)
    with pytest.raises(InputError, match="many worlds of a model with a flex, expected a model without one"):
        Rig(cloth, [Lidar(name="one", mount=Mount(), elevation_deg=[0], columns=4)]).sense([mujoco.MjData(cloth)])


@pytest.mark.parametrize("world", [-1, COUNT])
def test_worlds_that_a_frame_does_not_have_are_refused(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], world: int
) -> None:
    frame = rig_of(robot, "lidar").sense(datas)["lidar"]
    with pytest.raises(InputError, match=f"no world {world}, expected 0 to {COUNT - 1}"):
        frame.world(world)
    with pytest.raises(InputError, match="world: got float, expected int"):
        frame.world(1.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="got a frame of one world, expected one of many"):
        frame.world(np.int64(0)).world(0)  # type: ignore[arg-type]
