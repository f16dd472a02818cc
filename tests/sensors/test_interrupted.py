"""After a reading that was interrupted, by Ctrl-C or a lack of memory, the next one is as if that had not begun.

An exception can occur at any line of Python: here one is raised at every STEP-th line of rigcast that a reading runs,
but not at those of `with`. Python comes to these again when it leaves the block, and an exception there would leave a
lock held; one of a signal comes after it is released.
"""

import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from linecache import getline
from pathlib import Path
from types import FrameType
from typing import Any

import mujoco
import numpy as np
import pytest

import rigcast.kernels
import rigcast.sensors
from rigcast import DepthCamera, Frame, HeightScan, Lidar, Mount, Rig, Worlds, set_threads
from rigcast.kernels.launching.launch import LOADING

STEP = 199
FOLDERS = tuple(str(Path(str(room.__file__)).parent) for room in (rigcast.kernels, rigcast.sensors))
MODEL = """<mujoco>
  <asset><hfield name="hills" nrow="9" ncol="9" size="5 5 1 .3"/>
    <mesh name="tent" vertex="-1 -1 0  1 -1 0  -1 1 0  1 1 0  0 -.5 1  .2 .7 1.3"/></asset>
  <worldbody><geom type="hfield" hfield="hills" pos="0 0 -1"/><site name="mast" pos="0 0 3"/>
    <body name="robot"><freejoint/><geom type="mesh" mesh="tent"/><geom name="ball" size=".3" pos="1 1 1"/></body>
  </worldbody></mujoco>"""
SENSORS = (
    Lidar(name="lidar", mount=Mount(site="mast"), elevation_deg=np.linspace(-60, 10, 16).tolist(), columns=32),
    DepthCamera(name="eye", mount=Mount(site="mast"), resolution=(32, 24), fov_y_deg=60),
    HeightScan(name="feet", mount=Mount(site="mast"), size=(3, 3), spacing=0.2),
)
Readings = dict[str, Frame]


class Broken(Exception):
    pass


class BreakAt:
    """Raises at the n-th line of rigcast that is run within; `is_over` once fewer lines are run."""

    def __init__(self, line: int) -> None:
        self._left, self.where = line, ""

    @property
    def is_over(self) -> bool:
        return self._left > 0

    def __enter__(self) -> None:
        sys.settrace(self._trace)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> bool:
        sys.settrace(None)
        # Warp turns exceptions raised while it packs arguments into RuntimeErrors
        return kind is not None and issubclass(kind, Broken | RuntimeError)

    def _trace(self, frame: FrameType, event: str, argument: Any) -> Any:
        del argument
        if not frame.f_code.co_filename.startswith(FOLDERS):
            return None
        if event == "line" and not getline(frame.f_code.co_filename, frame.f_lineno).lstrip().startswith("with "):
            self._left -= 1
            if self._left == 0:
                self.where = f"{frame.f_code.co_filename}:{frame.f_lineno}"
                raise Broken
        return self._trace


class Place:
    """A model that changes, with states of it."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(MODEL)
        self.datas = [mujoco.MjData(self.model) for _ in range(3)]

    def change(self, seed: int) -> None:
        rng, model = np.random.default_rng(seed), self.model
        model.hfield_data[:] = rng.random(model.nhfielddata)
        model.mesh_vert[:] = rng.normal(size=model.mesh_vert.shape)
        model.geom("ball").size[0] = rng.uniform(0.1, 0.9)
        model.geom("ball").rgba[3] = seed % 2
        for data in self.datas:
            data.qpos[:3] = rng.normal((0, 0, 1), size=3)
            mujoco.mj_kinematics(model, data)


def one(rig: Rig, place: Place, seed: int) -> Readings:
    return rig.sense(place.datas[seed % 3])


def many(rig: Rig, place: Place, seed: int) -> Readings:
    return rig.sense(place.datas[: 1 + seed % 3])


def of_many_sizes(rig: Rig, place: Place, seed: int) -> Readings:
    datas = place.datas[: 1 + seed % 3]
    sizes = np.tile(place.model.geom_size, (len(datas), 1, 1))
    sizes[:, -1, 0] *= np.arange(1, len(datas) + 1)
    return rig.sense(Worlds(datas, geom_size=sizes))


@pytest.mark.parametrize("then", [one, many, of_many_sizes], ids=lambda read: read.__name__)
@pytest.mark.parametrize("broken", [one, many, of_many_sizes], ids=lambda read: read.__name__)
def test_next_reading_is_as_if_the_broken_one_had_not_been(
    broken: Callable[[Rig, Place, int], Readings],
    then: Callable[[Rig, Place, int], Readings],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else it could read old sizes, heights and meshes, or write beyond its arrays, which ends the process."""
    monkeypatch.setenv("RIGCAST_THREADS", "")
    set_threads(2)
    place = Place()
    place.change(0)
    rig = Rig(place.model, SENSORS, "cpu")
    for read in (broken, then, many):  # all is loaded by now, and there is an earlier frame of each shape
        read(rig, place, 2)
    for seed in range(1, 1000):
        place.change(seed)
        rig.scene.refresh("tent")
        breaking = BreakAt(seed * STEP)
        with breaking:
            broken(rig, place, seed)
        if breaking.is_over:
            break
        got, expected = then(rig, place, seed), then(Rig(place.model, SENSORS, "cpu"), place, seed)
        for name, frame in got.items():
            for field in ("range", "normal", "geom_id", "points"):
                values, right = (np.asarray(getattr(f, field).numpy()) for f in (frame, expected[name]))
                what = f"seed {seed}: {field} of {name!r} after {breaking.where}"
                np.testing.assert_array_equal(values, right, err_msg=what)
    else:
        raise AssertionError(f"a reading of more than {1000 * STEP} lines")
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(is_free, LOADING).result(), "a broken reading holds what other threads wait for"


def is_free(lock: Any) -> bool:
    """Whether this thread can take the lock, and releases it again."""
    is_taken = bool(lock.acquire(blocking=False))
    if is_taken:
        lock.release()
    return is_taken
