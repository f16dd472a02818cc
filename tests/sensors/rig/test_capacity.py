"""Memory of many worlds: it is as predicted, and nothing is allocated for more worlds than fit."""

import gc
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from world_states import SENSORS, model, rig_of, states

from rigcast import DepthCamera, InputError, Lidar, Mount, Rig, Worlds

pytestmark = pytest.mark.usefixtures("no_older_objects")

MANY_GEOMS = "".join(f'<geom size="0.1" pos="{x} {y} 1"/>' for x in range(6) for y in range(6))

WORLDBODIES = {"36 geoms": MANY_GEOMS, "6 geoms": MANY_GEOMS[: len(MANY_GEOMS) // 6]}


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other threads release the arrays of a launch a moment after it is done."""
    monkeypatch.setenv("RIGCAST_THREADS", "1")


def allocated() -> int:
    """Bytes of all Warp arrays that have memory of their own, and were made during the test."""
    gc.collect()
    arrays = [each for each in gc.get_objects() if type(each) is wp.array and each.ptr and each._ref is None]
    return sum({each.ptr: each.capacity for each in arrays}.values())


def poses(model: mujoco.MjModel, worlds: int) -> dict[str, Any]:
    """Poses of geoms in `worlds` worlds as in mujoco_warp: float32, on the device."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {
        "geom_xpos": wp.array(np.tile(data.geom_xpos, (worlds, 1, 1)), dtype=wp.vec3, device="cpu"),
        "geom_xmat": wp.array(
            np.tile(data.geom_xmat.reshape(-1, 3, 3), (worlds, 1, 1, 1)), dtype=wp.mat33, device="cpu"
        ),
    }


def on_the_host(model: mujoco.MjModel, worlds: int, dtype: type) -> dict[str, Any]:
    return {name: values.numpy().astype(dtype) for name, values in poses(model, worlds).items()}


def listed(model: mujoco.MjModel, worlds: int) -> list[mujoco.MjData]:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return [data] * worlds


def of_other_sizes(model: mujoco.MjModel, worlds: int) -> Worlds:
    """Worlds of float64 poses on the host, each with its own sizes and one geom left out."""
    scale = np.linspace(0.5, 1.5, worlds)[:, None, None]
    visible = np.arange(model.ngeom) != np.arange(worlds)[:, None] % model.ngeom
    return Worlds(on_the_host(model, worlds, np.float64), geom_size=scale * model.geom_size, visible=visible)


BATCHES: dict[str, Callable[[mujoco.MjModel, int], Any]] = {
    "on the device": poses,
    "float32": partial(on_the_host, dtype=np.float32),
    "float64": partial(on_the_host, dtype=np.float64),
    "list of MjData": listed,
    "sizes of their own": of_other_sizes,
}


def taken_by_worlds(rig: Rig, batch_of: Callable[[mujoco.MjModel, int], Any]) -> tuple[float, float]:
    """Bytes that stay with the rig for each of 1000 more worlds, and those of the frames beside that."""
    kept: dict[int, int] = {}
    taken: dict[int, int] = {}
    for worlds in (10, 1010):
        batch = batch_of(rig.model, worlds)
        before = allocated() - kept.get(10, 0)
        frames: Any = rig.sense(batch)
        taken[worlds] = allocated() - before
        del frames
        rig._mounted["one"].pool._last.clear()  # which are kept for later frames
        kept[worlds] = allocated() - before
    stays = kept[1010] - kept[10]
    return stays / 1000, (taken[1010] - taken[10] - stays) / 1000


def rig_under(worldbody: str) -> Rig:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{worldbody}</worldbody></mujoco>")
    return Rig(model, [Lidar(name="one", mount=Mount(), elevation_deg=[0, 10], columns=50)], device="cpu")


@pytest.mark.parametrize("worldbody", WORLDBODIES.values(), ids=list(WORLDBODIES))
@pytest.mark.parametrize("batch_of", BATCHES.values(), ids=list(BATCHES))
def test_each_world_takes_at_most_100_bytes_per_geom_beside_its_frames(
    worldbody: str, batch_of: Callable[[mujoco.MjModel, int], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigcast.sensors.rig.of_worlds.BYTES_AT_ONCE", 20_000)
    rig = rig_under(worldbody)
    stays, outputs = taken_by_worlds(rig, batch_of)
    own = 49 if batch_of is of_other_sizes else 0
    where = f"{stays / rig.model.ngeom:.0f} bytes per geom, {outputs:.0f} of frames"
    assert (own - 1) * rig.model.ngeom < stays <= own * rig.model.ngeom + 20 + 1, where  # 20 kB once
    assert 24 * 100 <= outputs <= 24 * 100 + 300, where


def test_trees_of_worlds_that_are_read_at_one_time_take_at_most_100_bytes_per_geom() -> None:
    rig = rig_under(MANY_GEOMS)
    stays, _ = taken_by_worlds(rig, poses)
    assert 0 < stays <= 100 * rig.model.ngeom, f"{stays / rig.model.ngeom:.0f} bytes per geom"


@pytest.mark.parametrize("name", list(SENSORS))
def test_what_a_world_is_said_to_take_is_no_less_than_it_takes(name: str) -> None:
    """Including the returned frames; the prediction includes temporary arrays of a reading, too."""
    robot = model()
    rig, taken = rig_of(robot, name), {}
    for worlds in (2, 22):
        datas = states(robot, worlds)
        before = allocated()
        frames: Any = rig.sense(datas)
        taken[worlds] = allocated() - before
        del frames
    batch = Worlds(datas)
    own = rig._mounted[name]
    said = rig.scene.bytes_per_world(batch) + own.bytes_per_world(batch)
    said += rig.scene.bytes_per_posed_world(batch) + own.bytes_per_posed_world
    assert 0 < (taken[22] - taken[2]) / 20 <= said


def test_more_worlds_than_memory_holds_are_refused_before_anything_is_allocated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = model()
    rig, datas = rig_of(robot, "lidar", "flight"), states(robot, 3)
    monkeypatch.setattr("rigcast.sensors.rig.capacity.free_memory", lambda _: 50_000)
    before = allocated()
    expected = (
        r"3 worlds need [\d.]+ kB, [\d.]+ kB each \(lidar 2\.11 kB, flight [\d.]+ kB\) and [\d.]+ kB to compute them, "
        r"expected at most 0: 50 kB are free on cpu"
    )
    with pytest.raises(InputError, match=expected):
        rig.sense(datas)
    assert allocated() <= before  # less if data about an earlier list of MjData are dropped


def test_frames_that_are_written_over_need_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, datas = rig_of(model(), "lidar"), states(model(), 1) * 20
    monkeypatch.setattr("rigcast.sensors.rig.of_worlds.BYTES_AT_ONCE", 7_000)
    frames = rig.sense(datas)
    monkeypatch.setattr("rigcast.sensors.rig.capacity.free_memory", lambda _: 20_000)
    with pytest.raises(InputError, match="20 worlds need"):
        rig.sense(datas)
    assert rig.sense(datas, out=frames)["lidar"].range.ptr == frames["lidar"].range.ptr


def test_readings_that_need_as_much_as_the_one_before_do_not_ask_for_free_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot, asked = model(), list[wp.Device]()

    def free_memory(device: wp.Device) -> int:
        asked.append(device)
        return 10**9

    monkeypatch.setattr("rigcast.sensors.rig.capacity.free_memory", free_memory)
    rig, datas = rig_of(robot, "lidar"), states(robot, 1) * 20
    frames = rig.sense(datas)
    rig.sense(datas, out=frames)  # the size of the trees is known from here on
    asked.clear()
    rig.sense(datas, out=frames)
    assert not asked
    rig.sense(datas)
    assert len(asked) == 1, "frames that are held are not written over"
    rig.sense(datas[:10])
    rig.sense(datas, out=frames)
    assert len(asked) == 3, "other numbers of worlds need as much as they do"


def test_worlds_that_fit_in_parts_are_not_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = model()
    rig, datas = rig_of(robot, "lidar"), states(robot, 1) * 20
    monkeypatch.setattr("rigcast.sensors.rig.capacity.free_memory", lambda _: 50_000)
    with pytest.raises(
        InputError, match=r"20 worlds need [\d.]+ kB, 2\.11 kB each \(lidar 2\.11 kB\) and [\d.]+ kB to compute"
    ):
        rig.sense(datas)
    monkeypatch.setattr("rigcast.sensors.rig.of_worlds.BYTES_AT_ONCE", 7_000)
    assert rig.sense(datas)["lidar"].range.shape[0] == 20


def test_more_rays_than_kernels_count_are_refused() -> None:
    robot = model()
    rig = Rig(robot, [DepthCamera(name="wide", mount=Mount(), resolution=(500, 400), fov_y_deg=60.0)], "cpu")
    batch = {
        "geom_xpos": np.broadcast_to(np.float32(0), (11_000, robot.ngeom, 3)),
        "geom_xmat": np.broadcast_to(np.float32(0), (11_000, robot.ngeom, 9)),
    }
    expected = "11000 worlds of sensor 'wide' have 2200000000 rays, expected at most 2146435072: 10732 worlds"
    with pytest.raises(InputError, match=expected):
        rig.sense(batch)


@pytest.mark.cuda
def test_memory_that_was_freed_on_a_gpu_counts_as_free(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is free once the device has finished its work."""
    free = iter([0, 10**9])
    monkeypatch.setattr("rigcast.sensors.rig.capacity.free_memory", lambda _: next(free))
    robot = model()
    assert Rig(robot, [SENSORS["lidar"]], "cuda:0").sense(states(robot, 3))["lidar"].range.shape[0] == 3
