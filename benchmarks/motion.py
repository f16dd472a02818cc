"""Cost of motion of sensor and geoms during a reading: a lidar in the demo's warehouse with and without `motion`.

python benchmarks/motion.py [SECONDS]     of simulation, by default 2; both rigs are stepped in turns in one process
"""

import sys
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import rigcast

SCENE = Path(__file__).resolve().parents[1] / "configs" / "warehouse" / "warehouse.xml"
TABLE: dict[str, Any] = {"elevation_deg": np.linspace(-16.6, 16.6, 64).tolist(), "columns": 1024, "rate_hz": 10.0}


def main(seconds: float) -> None:
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("drive").id)
    own = rigcast.Filter(exclude_bodies=["dolly"], exclude_subtree=True, geom_groups=[0, 1, 2])
    mount = rigcast.Mount(site="lidar_top")
    rigs = {
        name: rigcast.Rig(model, [rigcast.Lidar(name="top", mount=mount, filter=own, motion=name == "moving", **TABLE)])
        for name in ("still", "moving")
    }
    spent: dict[tuple[str, bool], list[float]] = {}
    while data.time < seconds:
        mujoco.mj_step(model, data)
        for name, rig in rigs.items():
            start = time.process_time()
            gave_a_frame = bool(rig.step(data))
            spent.setdefault((name, gave_a_frame), []).append(1e3 * (time.process_time() - start))
    median = {key: float(np.median(times[1:])) for key, times in spent.items()}  # the first ones compile
    for name in rigs:
        print(f"{name}: {median[name, True]:.1f} ms of CPU time a frame, {median[name, False]:.2f} ms a step without")
    print(f"{median['moving', True] / median['still', True]:.1f} times as long a frame")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 2.0)
