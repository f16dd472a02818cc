"""Many worlds at once: each has the readings of that world alone."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp
from world_states import COUNT, ON_EACH, SENSORS, alone, arrays_of, assert_same, fields_of, model, rig_of, states

from rigcast import InputError, Mount, Prop, Scene, Worlds


@ON_EACH
def test_each_world_reads_what_it_reads_alone(robot: mujoco.MjModel, datas: list[mujoco.MjData], device: str) -> None:
    frames = rig_of(robot, device=device).sense(datas)
    for world, data in enumerate(datas):
        for name, frame in alone(robot, data, world, device=device).items():
            assert_same(frames[name].world(world), frame, f"world {world}")


def test_the_first_world_reads_what_one_mjdata_does(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    batch, one = rig_of(robot), rig_of(robot)
    for reading in range(2):
        # in a batch, a rosette's pattern is that at the time (number of the reading) / rate
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
    """Each world has one thing in front of its lidar, 1000 km away from that of the others."""
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
