"""The number of CPU threads: its sources, what is refused, and that no frame depends on it."""

import multiprocessing
import os

import mujoco
import numpy as np
import pytest

from rigcast import DepthCamera, InputError, Lidar, Mount, Rig, Scene, set_threads
from rigcast.kernels.launching.slices import thread_count

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <geom type="sphere" size=".5" pos="2 0 0"/><geom type="box" size=".1 9 9" pos="5 0 0" euler="0 10 20"/>
  <geom type="plane" size="0 0 1" pos="0 0 -1"/></worldbody></mujoco>""")


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIGCAST_THREADS", "")


def test_argument_or_variable_sets_it_and_none_is_as_many_as_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    every = thread_count()
    assert every >= 1
    set_threads(3)
    assert thread_count() == 3
    monkeypatch.setenv("RIGCAST_THREADS", "5")
    assert thread_count() == 5
    set_threads(None)
    assert thread_count() == every


@pytest.mark.parametrize("count", [0, -1, 1.5, True, "two", 10_000])
def test_argument_that_is_no_count_is_refused(count: int) -> None:
    with pytest.raises(InputError, match=r"set_threads: count: got .*, expected a whole number from 1 to 9999"):
        set_threads(count)


@pytest.mark.parametrize("value", ["0", "-2", "many", "2.0", " 2"])
def test_variable_that_is_no_count_is_refused_by_the_scene(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIGCAST_THREADS", value)
    with pytest.raises(InputError, match=f"RIGCAST_THREADS: got {value!r}, expected a whole number"):
        Scene(MODEL, "cpu")


def test_frames_of_one_thread_are_those_of_many() -> None:
    camera = DepthCamera(name="eye", mount=Mount(), resolution=(160, 120), fov_y_deg=60.0)
    lidar = Lidar(name="lidar", mount=Mount(), elevation_deg=[-20, -10, 0, 10], columns=2048)
    data, read = mujoco.MjData(MODEL), []
    for threads in (1, 2, 5):
        set_threads(threads)
        frames = Rig(MODEL, [camera, lidar], "cpu").sense(data).values()
        fields = [(f.range, f.normal, f.geom_id, f.points) for f in frames]
        read.append([array.numpy().tobytes() for frame in fields for array in frame])
        scene = Scene(MODEL, "cpu")
        scene.update(_posed())
        directions = np.random.default_rng(0).normal(size=(20_000, 3))
        hits = scene.cast(0.1 * directions[::-1], directions).numpy()
        read[-1] += [hits.distance.tobytes(), hits.normal.tobytes()]
    assert read[0] == read[1] == read[2]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_forked_process_has_threads_of_its_own() -> None:
    """Else a child would wait for ever for threads of its parent, which a fork does not copy."""
    set_threads(2)
    scene = Scene(MODEL, "cpu")
    scene.update(_posed())
    directions = np.random.default_rng(0).normal(size=(20_000, 3))
    expected = scene.cast((0, 0, 0), directions).numpy().distance

    def cast_again() -> None:
        os._exit(0 if np.array_equal(scene.cast((0, 0, 0), directions).numpy().distance, expected) else 1)

    child = multiprocessing.get_context("fork").Process(target=cast_again)
    child.start()
    child.join(60)
    child.kill()  # in vain, unless it hangs
    assert child.exitcode == 0


def _posed() -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    mujoco.mj_kinematics(MODEL, data)
    return data
