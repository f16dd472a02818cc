"""How many launches a frame makes and how many arrays it takes, once it has been read a few times: the host's time."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

from rigcast import Detection, Lidar, Mount, Noise, Rig, Weather
from rigcast.kernels.launching import recorded

XML = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <geom type="box" size="0.5 0.5 0.5" pos="3 0 0.5"/>
    <body name="carrier" pos="0 0 1"><freejoint/><geom size="0.1" pos="0 0 -0.3"/></body>
  </worldbody>
</mujoco>
"""
WORLDS = 3
NOISE = Noise(range_std=0.02)
FIELDS = ("geom_xpos", "geom_xmat", "xpos", "xmat")


def lidars(count: int, **options: Any) -> list[Lidar]:
    mount = Mount(body="carrier")
    return [Lidar(name=f"top{k}", mount=mount, elevation_deg=[-5, 0], columns=16, **options) for k in range(count)]


def one_world(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def several(model: mujoco.MjModel) -> list[mujoco.MjData]:
    return [one_world(model) for _ in range(WORLDS)]


def on_device(model: mujoco.MjModel) -> dict[str, wp.array]:
    """Poses of many worlds as mujoco_warp has them."""
    data = one_world(model)
    arrays = {}
    for name in FIELDS:
        dtype = wp.mat33 if name.endswith("mat") else wp.vec3
        values = np.broadcast_to(getattr(data, name), (WORLDS, *getattr(data, name).shape))
        shape = (*values.shape[:2], 3, 3) if dtype is wp.mat33 else values.shape
        arrays[name] = wp.array(values.reshape(shape), dtype=dtype, device="cpu")
    return arrays | {"time": wp.zeros(WORLDS, dtype=wp.float32, device="cpu")}


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts launches of kernels, and arrays made, views included."""
    made: Counter[str] = Counter()

    def counted(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counting(*arguments: Any, **options: Any) -> Any:
            made[name] += not options.get("record_cmd", False)
            return call(*arguments, **options)

        return counting

    monkeypatch.setenv("RIGCAST_THREADS", "1")
    monkeypatch.setattr(wp, "launch", counted("launches", wp.launch))
    monkeypatch.setattr(recorded._Shortened, "__call__", counted("launches", recorded._Shortened.__call__))
    monkeypatch.setattr(recorded._ByWarp, "__call__", counted("launches", recorded._ByWarp.__call__))
    monkeypatch.setattr(wp.array, "__init__", counted("arrays", wp.array.__init__))
    return made


@pytest.mark.parametrize(
    ("source", "sensors", "launches", "arrays"),
    [
        (one_world, lidars(1), 4, 0),  # poses taken, tree refitted, sensor placed, rays cast
        (one_world, lidars(3), 8, 0),
        (on_device, lidars(1), 3, 0),
        (on_device, lidars(3), 7, 0),
        # positions and rotations of geoms and bodies gathered; three of the arrays are of the host, to be copied
        (several, lidars(1), 4 + 3, 3),
        # with errors: sensor placed, rays cast, echoes, returns, draws, ranges, readings; an array of intensities
        (one_world, lidars(1, noise=NOISE), 2 + 7, 1),
        (one_world, lidars(3, noise=NOISE), 2 + 3 * 7, 3),
        (on_device, lidars(3, noise=NOISE), 1 + 3 * 7, 3),
        (on_device, lidars(1, noise=NOISE, returns="dual"), 1 + 8, 1),
        (on_device, lidars(1, mirrors=True, max_surfaces=3), 1 + 7, 1),
        (on_device, lidars(1, weather=Weather(rain_rate=5), detection=Detection(range=100)), 1 + 8, 1),
    ],
)
def test_a_frame_makes_few_launches_and_hardly_an_array(
    source: Callable[[mujoco.MjModel], Any],
    sensors: Sequence[Lidar],
    launches: int,
    arrays: int,
    counts: Counter[str],
) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    rig, batch = Rig(model, sensors, device="cpu"), source(model)
    for _ in range(4):
        rig.sense(batch)
    counts.clear()
    rig.sense(batch)
    assert (counts["launches"], counts["arrays"]) == (launches, arrays)
