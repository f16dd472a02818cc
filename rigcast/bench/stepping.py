"""Measurements of a step's cost besides the cast, by CPU time of all threads: update and small frames."""

import time
from collections.abc import Iterator

import mujoco
import numpy as np

from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount

from .figure import Figure, Spread
from .race import in_turns
from .workloads import room

CALLS = 100


def update(rounds: int) -> Iterator[Figure]:
    """`Scene.update` after every geom has moved."""
    for geoms in (130, 1600):
        workload = room(geoms - 5)
        scene, data = Scene(workload.model, "cpu"), workload.data
        times = []
        for _ in range(20 * rounds):
            data.geom_xpos += 1e-3
            began = time.process_time()
            scene.update(data)
            times.append(time.process_time() - began)
        yield Figure(f"update_{geoms}", f"Scene.update, {geoms} geoms", "ms", Spread.of(1e3 * np.array(times[rounds:])))


def small(rounds: int) -> Iterator[Figure]:
    """`sense` of a sensor with one ray in a scene of ten geoms, and that less mj_kinematics and mj_ray of the same."""
    balls = "".join(f'<body pos="{k} 1 0"><freejoint/><geom size=".3"/></body>' for k in range(9))
    xml = f'<mujoco><worldbody>{balls}<geom type="plane" size="0 0 1" pos="0 0 -1"/></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    data, start, down = mujoco.MjData(model), np.zeros(3), np.array([0.0, 0.0, -1.0])
    rig = Rig(model, [Lidar(name="one", mount=Mount(), elevation_deg=[-90.0], columns=1)], "cpu")
    geom_id = np.zeros(1, np.int32)

    def ours() -> None:
        for _ in range(CALLS):
            rig.sense(data)["one"].range.numpy()

    def theirs() -> None:
        for _ in range(CALLS):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_ray(model, data, start, down, None, True, -1, geom_id)

    times = in_turns({"ours": ours, "theirs": theirs}, rounds)
    took, less = (1e6 / CALLS * t for t in (times["ours"][1], times["ours"][1] - times["theirs"][1]))
    yield Figure("small", "sense of one ray, ten geoms", "us", Spread.of(took))
    yield Figure("small_less", "the same, less mj_kinematics and mj_ray", "us", Spread.of(less))
