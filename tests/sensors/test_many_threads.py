"""Rigs in many threads: each thread's own rig reads as in one thread; a shared rig refuses a second thread."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import mujoco
import pytest

from rigcast import InputError, Lidar, Mount, Rig, Scene

EACH_ITS_OWN = """
import sys
from concurrent.futures import ThreadPoolExecutor
import mujoco, numpy as np
import rigcast
from rigcast import DepthCamera, HeightScan, Lidar, Mount, Noise, Rig

rigcast.set_threads(2)
sys.setswitchinterval(1e-5)
mount = Mount(pos=(0, 0, 3))
sensors = [
    Lidar(name="noisy", mount=mount, elevation_deg=[-60, -30, 0, 10], columns=512, noise=Noise(range_std=0.01)),
    Lidar(name="rosette", mount=mount, preset="livox_mid40"),
    DepthCamera(name="eye", mount=mount, resolution=(160, 120), fov_y_deg=60),
    HeightScan(name="feet", mount=mount, size=(3, 3), spacing=0.1),
]
XML = '''<mujoco><asset><hfield name="hills" nrow="9" ncol="9" size="5 5 1 .3"/>
  <mesh name="tent" vertex="-1 -1 0  1 -1 0  -1 1 0  1 1 0  0 -.5 1  .2 .7 1.3"/></asset>
  <worldbody><geom type="hfield" hfield="hills" pos="0 0 -1"/>
    <body><freejoint/><geom type="mesh" mesh="tent"/><geom size=".3" pos="1 1 1"/></body></worldbody></mujoco>'''

def read(_):
    model = mujoco.MjModel.from_xml_string(XML)
    rig, data, read = Rig(model, sensors, "cpu"), mujoco.MjData(model), []
    for _ in range(5):
        mujoco.mj_step(model, data)
        for frame in rig.step(data):
            read += [field.numpy().tobytes() for field in (frame.range, frame.points, frame.body_id)]
        rig.scene.update(data)
        directions = np.random.default_rng(0).normal(size=(5000, 3))
        read.append(rig.scene.cast((0, 0, 3), directions).numpy().distance.tobytes())
    return read

with ThreadPoolExecutor(4) as pool:
    first, *others = pool.map(read, range(4))
assert all(other == first for other in [*others, read(0)])
"""
MODEL = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
LIDAR = Lidar(name="lidar", mount=Mount(pos=(3, 0, 0)), elevation_deg=[0], columns=4)


@pytest.mark.parametrize("turn", range(2))
def test_rigs_made_in_threads_of_their_own_read_what_one_thread_reads(turn: int) -> None:
    """Threads that load kernels at once can end the process or give other frames, in a third of all runs."""
    done = subprocess.run([sys.executable, "-c", EACH_ITS_OWN], env=dict(os.environ), capture_output=True, text=True)
    assert done.returncode == 0, f"turn {turn}: {done.stderr[-2000:]}"


def posed() -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    mujoco.mj_kinematics(MODEL, data)
    return data


USES: dict[str, Callable[[Rig], object]] = {
    "sense": lambda rig: rig.sense(posed()),
    "sense worlds": lambda rig: rig.sense([posed()]),
    "step": lambda rig: rig.step(posed()),
    "rays": lambda rig: rig.rays(posed()),
    "cast": lambda rig: rig.cast(posed()),
    "reset": lambda rig: rig.reset(),
    "update": lambda rig: rig.scene.update(posed()),
    "scene's cast": lambda rig: rig.scene.cast((3, 0, 0), (-1, 0, 0)),
}


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_a_rig_in_use_refuses_another_thread(use: Callable[[Rig], object]) -> None:
    """Else frames would mix both readings."""
    rig = Rig(MODEL, [LIDAR], "cpu")
    rig.scene.update(posed())
    with ThreadPoolExecutor(1) as pool:
        with rig.scene.in_use:
            with pytest.raises(InputError, match="in use by another thread, expected one thread at a time"):
                pool.submit(use, rig).result()
            use(rig)  # by the same thread, which may call it within a call
        pool.submit(use, rig).result()


def test_what_is_refused_or_fails_leaves_a_rig_free() -> None:
    rig, stranger = Rig(MODEL, [LIDAR], "cpu"), mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
    with pytest.raises(InputError, match="another model"):
        rig.sense(stranger)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(rig.sense, posed()).result().keys() == {"lidar"}


def test_a_rig_of_all_threads_gives_whole_frames_or_none() -> None:
    rig, expected = Rig(MODEL, [LIDAR], "cpu"), Rig(MODEL, [LIDAR], "cpu").sense(posed())["lidar"].range.numpy()
    wrong, begin = [], threading.Barrier(4)

    def read() -> None:
        data = posed()
        begin.wait()
        for _ in range(200):
            try:
                got = rig.sense(data)["lidar"].range.numpy()
            except InputError:
                continue
            if got.tobytes() != expected.tobytes():
                wrong.append(got)

    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_a_scene_in_use_refuses_another_thread() -> None:
    scene = Scene(MODEL, "cpu")
    with ThreadPoolExecutor(1) as pool, scene.in_use, pytest.raises(InputError, match="in use by another thread"):
        pool.submit(scene.update, posed()).result()
