"""Worlds read in parts, as many at a time as poses and trees have room for, have the readings of all at once."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from world_states import arrays_of, assert_same, model, on_device, rig_of, states

from rigcast import Filter, Frame, InputError, Mount, Rig, Worlds

COUNT = 5
AT_A_TIME = {1: [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)], 2: [(0, 2), (2, 4), (3, 5)], 4: [(0, 3), (2, 5)], 5: [(0, 5)]}


@pytest.fixture
def datas(robot: mujoco.MjModel) -> list[mujoco.MjData]:
    return states(robot, COUNT)


def make_room(monkeypatch: pytest.MonkeyPatch, rig: Rig, batch: Any, at_a_time: int) -> None:
    """Limit the memory of readings to that of `at_a_time` worlds."""
    worlds = batch if isinstance(batch, Worlds) else Worlds(batch)
    errors = max(m.bytes_per_posed_world for m in rig._mounted.values())
    room = at_a_time * (rig.scene.bytes_per_posed_world(worlds) + errors)
    monkeypatch.setattr("rigcast.sensors.rig.of_worlds.BYTES_AT_ONCE", room)


def parts_of(rig: Rig) -> list[tuple[int, int]]:
    """A list to which the parts (begin, end) of worlds are added as they are posed from now on."""
    parts, pose_worlds = [], rig.scene.pose_worlds

    def noted(worlds: Worlds, part: slice) -> Any:
        parts.append((part.start, part.stop))
        return pose_worlds(worlds, part)

    rig.scene.pose_worlds = noted  # type: ignore[method-assign]
    return parts


def assert_same_frames(got: dict[str, Frame], expected: dict[str, Frame], where: str) -> None:
    assert got.keys() == expected.keys()
    for name, frame in got.items():
        assert_same(frame, expected[name], where)


@pytest.mark.parametrize(("most", "parts"), AT_A_TIME.items(), ids=[f"{most} at a time" for most in AT_A_TIME])
def test_every_sensor_reads_the_same(
    robot: mujoco.MjModel,
    datas: list[mujoco.MjData],
    monkeypatch: pytest.MonkeyPatch,
    most: int,
    parts: list[tuple[int, int]],
) -> None:
    whole, rig = rig_of(robot), rig_of(robot)
    make_room(monkeypatch, rig, datas, most)
    stood = parts_of(rig)
    got = rig.sense(datas)
    assert stood == parts
    monkeypatch.undo()
    assert_same_frames(got, whole.sense(datas), f"{most} at a time")


def differing(datas: list[mujoco.MjData]) -> Worlds:
    """Worlds that differ in everything in which worlds can differ."""
    robot, rng = model(), np.random.default_rng(8)
    dataid = np.tile(robot.geom_dataid, (COUNT, 1))
    dataid[:, robot.geom("tent").id] = [robot.mesh("cube").id, robot.mesh("tent").id, -1, -1, robot.mesh("cube").id]
    return Worlds(
        on_device(datas),
        geom_size=robot.geom_size * rng.uniform(0.5, 1.5, (COUNT, 1, 1)),
        geom_dataid=dataid,
        visible=rng.random((COUNT, robot.ngeom)) < 0.8,
        filters={"lidar": [Filter(exclude_bodies=["robot"]), Filter(static=False)] * 2 + [Filter()]},
        mounts={"weather": [Mount(site="nose", euler_deg=(0, 0, 10 * k)) for k in range(COUNT)]},
        active=wp.array([True, False, True, True, True], dtype=wp.bool, device="cpu"),
        ids=range(7, 7 + COUNT),
    )


def float32(datas: list[mujoco.MjData]) -> Any:
    return {name: values.astype(np.float32) for name, values in arrays_of(datas).items()}


def nested(datas: list[mujoco.MjData]) -> Any:
    return {name: values.tolist() for name, values in arrays_of(datas).items()}


@pytest.mark.parametrize("batch_of", [arrays_of, float32, nested, on_device, differing])
def test_every_batch_reads_the_same_again_and_again(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], monkeypatch: pytest.MonkeyPatch, batch_of: Any
) -> None:
    names = ("lidar", "scan", "rosette", "noisy", "weather", "stereo", "flight")
    whole, rig, batch = rig_of(robot, *names), rig_of(robot, *names), batch_of(datas)
    expected = [whole.sense(batch) for _ in range(3)]
    make_room(monkeypatch, rig, batch, 2)
    frames = rig.sense(batch)
    assert_same_frames(frames, expected[0], f"{batch_of.__name__}, first")
    assert_same_frames(rig.sense(batch), expected[1], f"{batch_of.__name__}, second")
    rig.sense(batch, out=frames)
    assert_same_frames(frames, expected[2], f"{batch_of.__name__}, into the arrays of the first")


def test_arrays_that_nobody_holds_serve_again(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = rig_of(robot)
    make_room(monkeypatch, rig, datas, 2)
    where = [{name: frame.range.ptr for name, frame in rig.sense(datas).items()} for _ in range(3)]
    assert where[1] == where[2] == where[0]


def test_geoms_that_are_not_finite_are_named_with_their_worlds(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], monkeypatch: pytest.MonkeyPatch
) -> None:
    arrays, rig = arrays_of(datas), rig_of(robot, "lidar")
    arrays["geom_xpos"][3, robot.geom("ball").id] = np.nan
    make_room(monkeypatch, rig, arrays, 2)
    with pytest.warns(RuntimeWarning, match=r"not finite, not hit: ball \(world 3\)"):
        rig.sense(arrays)
    rig.sense(arrays)  # it has been named


def test_a_world_that_was_never_worked_out_is_told(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, batch = rig_of(robot, "lidar"), [*datas[:4], mujoco.MjData(robot)]
    make_room(monkeypatch, rig, batch, 2)
    for _ in range(2):
        with pytest.raises(InputError, match="geom_xmat of world 4 has not been computed"):
            rig.sense(batch)
    assert len(rig._mounted["lidar"].pool._last) == 1
    assert_same_frames(rig.sense(datas), rig_of(robot, "lidar").sense(datas), "after those that were refused")


def test_fields_of_other_lengths_are_refused(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, arrays = rig_of(robot, "lidar"), arrays_of(datas)
    arrays["xpos"] = np.concatenate([arrays["xpos"]] * 2)
    make_room(monkeypatch, rig, arrays, 2)
    with pytest.raises(InputError, match=r"xpos: got shape \(10, 5, 3\), expected \(5, \.\.\.\): one per world"):
        rig.sense(arrays)


def test_a_scene_of_some_of_the_worlds_is_not_cast_at(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = rig_of(robot, "lidar")
    make_room(monkeypatch, rig, datas, 2)
    rig.sense(datas)
    with pytest.raises(InputError, match=r"only some of many worlds stand in it, expected scene\.update"):
        rig.scene.cast((0, 0, 1), np.ones((COUNT, 3)))
    rig.scene.update(datas)
    assert rig.scene.cast((0, 0, 1), np.ones((COUNT, 3))).distance.shape == (COUNT,)
