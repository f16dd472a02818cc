"""Many worlds at once: each reads what it would read alone, from whatever holds its poses."""

import gc
import weakref
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp
from small_scenes import Elsewhere
from world_states import SENSORS, alone, arrays_of, assert_same, fields_of, model, on_device, rig_of, states

from rigcast import InputError, Lidar, Mount, Prop, Rig, Scene, Worlds

COUNT = 4
ON_EACH = pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])


@pytest.fixture(scope="module")
def robot() -> mujoco.MjModel:
    return model()


@pytest.fixture
def datas(robot: mujoco.MjModel) -> list[mujoco.MjData]:
    return states(robot, COUNT)


@ON_EACH
def test_each_world_reads_what_it_reads_alone(robot: mujoco.MjModel, datas: list[mujoco.MjData], device: str) -> None:
    frames = rig_of(robot, device=device).sense(datas)
    for world, data in enumerate(datas):
        for name, frame in alone(robot, data, world, device=device).items():
            assert_same(frames[name].world(world), frame, f"world {world}")


def test_the_first_world_reads_what_one_mjdata_does(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    batch, one = rig_of(robot), rig_of(robot)
    for reading in range(2):
        # a rosette's pattern in a batch is that of the time which its rate makes of the number of the reading
        datas[0].time = reading / 100
        frames = batch.sense(datas)
        for name, frame in one.sense(datas[0]).items():
            assert_same(frames[name].world(0), frame, "world 0")


def test_fields_have_a_first_axis_for_the_world(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    for name, frame in rig_of(robot).sense(datas).items():
        for field, values in fields_of(frame).items():
            assert values.shape[0] == COUNT, f"{name}: {field}"
            expected = np.array([fields_of(frame.world(k))[field] for k in range(COUNT)])
            np.testing.assert_array_equal(values, expected, err_msg=f"{name}: {field}")
    vectors = rig_of(robot, "noisy").sense(datas)["noisy"].points
    assert np.from_dlpack(vectors).shape == (COUNT, 3, 24, 2, 3)


def test_one_world_is_a_batch_too(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    frame = rig_of(robot, "lidar").sense(datas[:1])["lidar"]
    assert frame.range.shape == (1, 3, 24)
    assert_same(frame.world(0), rig_of(robot, "lidar").sense(datas[0])["lidar"], "one world")


def test_worlds_are_told_apart_where_the_scenes_differ(robot: mujoco.MjModel) -> None:
    """Each world has one thing before its camera, 1000 km from where the others have theirs."""
    datas = []
    for k, name in enumerate(("ball", "tent", "can")):
        data = mujoco.MjData(robot)
        far = 1e6 * (k + 1)
        for body in ("robot", "ball", "tent", "can"):
            ahead = 2.0 if body == name else -50.0
            data.joint(robot.body(body).jntadr[0]).qpos[:3] = [far + (0 if body == "robot" else ahead), 0, 10]
        mujoco.mj_kinematics(robot, data)
        datas.append(data)
    seen = rig_of(robot, "lidar").sense(datas)["lidar"].geom_id.numpy()
    floor = robot.geom("floor").id
    for k, name in enumerate(("ball", "tent", "can")):
        assert set(np.unique(seen[k])) <= {-1, floor, robot.geom(name).id}, name
        assert (seen[k] == robot.geom(name).id).any(), name


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
    """Where each MjData has its poses is known from the last reading: others in its place are others."""
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
    """Rotations as matrices, positions as lists."""
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
    with pytest.raises(InputError, match=r"xmat of world 0 has not been worked out .* batch\.forward\(\)"):
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
    """Poses as float32 has them."""
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


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_world_that_is_not_finite_disturbs_no_other(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], bad: float
) -> None:
    arrays = arrays_of(datas)
    for name in arrays.keys() - {"time"}:
        arrays[name][1] = bad
    rig = rig_of(robot)
    with pytest.warns(RuntimeWarning, match=r"not finite, not hit: floor \(world 1\), hill \(world 1\)"):
        frames = rig.sense(arrays)
    expected = rig_of(robot).sense(datas)
    for name, frame in frames.items():
        if name != "fixed":
            assert np.isnan(frame.range.numpy()[1]).all(), name
        for world in (0, 2, 3):
            assert_same(frame.world(world), expected[name].world(world), f"world {world}")


def test_a_geom_that_is_not_finite_is_missing_in_its_world_only(
    robot: mujoco.MjModel, datas: list[mujoco.MjData]
) -> None:
    arrays, expected = arrays_of(datas), rig_of(robot, "lidar").sense(datas)["lidar"]
    seen = int(expected.geom_id.numpy()[2].max())
    assert seen > robot.geom("robot").id
    arrays["geom_xpos"][2, seen] = np.nan
    with pytest.warns(RuntimeWarning, match=rf"not finite, not hit: {robot.geom(seen).name} \(world 2\)"):
        got = rig_of(robot, "lidar").sense(arrays)["lidar"]
    assert not (got.geom_id.numpy()[2] == seen).any()
    for world in (0, 1, 3):
        assert_same(got.world(world), expected.world(world), f"world {world}")


@ON_EACH
@pytest.mark.parametrize("as_warp", [False, True])
def test_worlds_that_are_not_active_are_nan_and_disturb_no_other(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], as_warp: bool, device: str
) -> None:
    active = np.array([True, False, True, False])
    mask = wp.array(active, dtype=wp.bool, device=device) if as_warp else active
    frames = rig_of(robot, device=device).sense(Worlds(datas, active=mask))
    expected = rig_of(robot, device=device).sense(datas)
    for name, frame in frames.items():
        assert np.isnan(frame.range.numpy()[[1, 3]]).all(), name
        assert (frame.geom_id.numpy()[[1, 3]] == -1).all(), name
        for world in (0, 2):
            assert_same(frame.world(world), expected[name].world(world), f"world {world}")


@ON_EACH
def test_a_mask_on_the_device_is_read_at_each_reading(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], device: str
) -> None:
    active = wp.array([True] * COUNT, dtype=wp.bool, device=device)
    worlds, rig = Worlds(datas, active=active), rig_of(robot, "lidar", device=device)
    for chosen in ([True, True, False, True], [False, True, True, True]):
        active.assign(chosen)
        is_nan = np.isnan(rig.sense(worlds)["lidar"].range.numpy()).all(axis=(1, 2))
        assert is_nan.tolist() == [not each for each in chosen]


def test_random_numbers_follow_the_ids_of_the_worlds(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    whole = rig_of(robot).sense(datas)
    shard = rig_of(robot).sense(Worlds(datas[2:], ids=[2, 3]))
    same = rig_of(robot, "noisy").sense([datas[0]] * COUNT)["noisy"].range.numpy()
    for name in SENSORS:
        for k in range(2):
            assert_same(shard[name].world(k), whole[name].world(2 + k), f"world {2 + k}")
    assert all((same[k] != same[0]).any() for k in range(1, COUNT))


def test_props_move_with_their_bodies(robot: mujoco.MjModel, datas: list[mujoco.MjData], tmp_path: Path) -> None:
    trimesh.creation.box((0.4, 0.5, 0.6)).export(tmp_path / "box.stl")
    mounts = {"crate": Mount(body="can", pos=(0.5, 0, 0.4), euler_deg=(10, 20, 30)), "post": Mount(pos=(1, 1, 0.5))}
    props = tuple(Prop(name=name, file=tmp_path / "box.stl", mount=mount) for name, mount in mounts.items())
    frames = rig_of(robot, props=props).sense(datas)
    assert set(np.unique(fields_of(frames["lidar"])["prop_id"])) == {-1, 0, 1}
    for world, data in enumerate(datas):
        for name, frame in alone(robot, data, world, props=props).items():
            assert_same(frames[name].world(world), frame, f"world {world}")


def test_edits_of_the_model_are_seen_in_all_worlds() -> None:
    robot = model()
    datas = states(robot, COUNT)
    rig = rig_of(robot, "scan")
    rig.sense(datas)
    robot.hfield_data[:] = 1 - robot.hfield_data
    robot.geom_size[robot.geom("can").id] *= 2
    assert_same(rig.sense(datas)["scan"], rig_of(robot, "scan").sense(datas)["scan"], "edited")


@ON_EACH
def test_a_scene_of_many_worlds_is_cast_with_rays_for_each(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], device: str
) -> None:
    scene, rng = Scene(robot, device), np.random.default_rng(1)
    directions, origins = rng.normal(size=(COUNT, 50, 3)), rng.normal((0, 0, 3), size=(COUNT, 50, 3))
    scene.update(datas)
    hits = scene.cast(origins, directions).numpy()
    from_one = scene.cast(origins[0, 0], directions).numpy()
    on_device = scene.cast(*(wp.array(each, dtype=wp.vec3d, device=device) for each in (origins, directions))).numpy()
    with pytest.raises(InputError, match=r"directions: got shape \(50, 3\), expected \(4, \.\.\., 3\)"):
        scene.cast(origins[0], directions[0])
    for world, data in enumerate(datas):
        scene.update(data)
        alone, shared = scene.cast(origins[world], directions[world]), scene.cast(origins[0, 0], directions[world])
        for field in ("distance", "geom_id", "face", "normal"):
            where = f"world {world}: {field}"
            np.testing.assert_array_equal(getattr(hits, field)[world], getattr(alone.numpy(), field), err_msg=where)
            np.testing.assert_array_equal(getattr(from_one, field)[world], getattr(shared.numpy(), field), where)
            np.testing.assert_array_equal(getattr(on_device, field)[world], getattr(alone.numpy(), field), where)


def test_pictures_are_of_one_world(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    frame = rig_of(robot, "noisy").sense(datas)["noisy"]
    with pytest.raises(InputError, match=r"got a frame of 4 worlds, expected one of one world, such as frame\.world"):
        frame.picture()
    assert frame._repr_png_() is None
    alone = rig_of(robot, "noisy").sense(datas[0])["noisy"]
    assert frame.world(0)._repr_png_() == alone._repr_png_()


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
    with pytest.raises(InputError, match="geom_xmat of world 2 has not been worked out, expected mj_forward or"):
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
