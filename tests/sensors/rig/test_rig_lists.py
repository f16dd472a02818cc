"""A list of MjData is read with its present poses; a rig warns if these are of the step before."""

import warnings
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from rigcast import HeightScan, Mount, Rig, Worlds

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom type="plane" size="0 0 1"/>
  <body name="robot" pos="1e6 0 9"><freejoint/><geom size=".1" pos=".1 .2 0"/></body></worldbody></mujoco>""")
SCAN = HeightScan(name="scan", mount=Mount(pos=(0, 0, 5)), size=(1, 1), spacing=0.5)


def stepped(data: mujoco.MjData) -> None:
    for _ in range(5):
        mujoco.mj_step(MODEL, data)


def forward(data: mujoco.MjData) -> None:
    stepped(data)
    mujoco.mj_forward(MODEL, data)


def kinematics(data: mujoco.MjData) -> None:
    data.qpos[:7] = np.random.default_rng(0).normal(size=7)  # a quaternion not of unit length
    mujoco.mj_kinematics(MODEL, data)


def lost(data: mujoco.MjData) -> None:
    data.qpos[:3] = np.nan
    mujoco.mj_kinematics(MODEL, data)


Prepare = Callable[[mujoco.MjData], None]


def said(rig: Rig, read: Callable[[list[mujoco.MjData]], object], turns: tuple[Prepare, ...]) -> list[int]:
    """The turns in which a rig warns of stale poses, when data are prepared in these ways, one per turn."""
    datas, warned = [mujoco.MjData(MODEL) for _ in range(2)], []
    for turn, prepare in enumerate(turns):
        for data in datas:
            prepare(data)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            rig.sense(read(datas))
        stale = [warning for warning in caught if "mj_step leaves them a step behind" in str(warning.message)]
        assert all("expected mujoco.mj_kinematics" in str(w.message) and w.filename == __file__ for w in stale)
        warned += [turn] * len(stale)
    return warned


@pytest.mark.parametrize(
    ("turns", "warned"),
    [
        pytest.param((stepped, stepped, stepped), [0], id="once"),
        pytest.param((forward, stepped, stepped), [1], id="in a loop after a first look"),
        pytest.param((forward, forward, stepped), [], id="later readings cost nothing"),
        pytest.param((kinematics, kinematics), [], id="kinematics"),
        pytest.param((lost, lost), [], id="a pose that is lost"),
    ],
)
@pytest.mark.parametrize("read", [list, Worlds], ids=["list", "Worlds"])
def test_poses_of_the_step_before_are_told(
    read: Callable[[list[mujoco.MjData]], object], turns: tuple[Prepare, ...], warned: list[int]
) -> None:
    """An MjData in a list is read with other poses than alone, which must not happen silently."""
    assert said(Rig(MODEL, [SCAN], "cpu"), read, turns) == warned


@pytest.mark.parametrize(
    "read",
    [
        lambda datas: Worlds(datas, active=[False, True]),
        lambda datas: {name: np.array([getattr(data, name) for data in datas]) for name in ("geom_xpos", "geom_xmat")},
    ],
    ids=["worlds that are not sensed", "arrays"],
)
def test_other_worlds_are_read_as_they_stand(read: Callable[[list[mujoco.MjData]], object]) -> None:
    assert said(Rig(MODEL, [SCAN], "cpu"), read, (stepped, stepped)) == []
