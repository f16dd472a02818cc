"""An occupancy map from a lidar: the demo robot drives and maps the warehouse from above.

python examples/map_from_lidar.py [--seconds S] [--picture FILE]
"""

from pathlib import Path

import mujoco
import numpy as np
import typer
from PIL import Image

import rigcast

CELL = 0.05  # m
RIG = Path(__file__).parent.parent / "configs" / "demo.yaml"
LOW, HIGH = 0.1, 1.8  # m, what a robot can run into


def main(seconds: float = 3.0, picture: str = "map.png") -> None:
    rig = rigcast.load_rig(RIG, overrides=["sensors.lidar_low.rate_hz=20"])
    data = mujoco.MjData(rig.model)
    mujoco.mj_resetDataKeyframe(rig.model, data, 0)
    hits = np.zeros((400, 400), dtype=int)
    for _ in range(round(seconds / rig.model.opt.timestep)):
        mujoco.mj_step(rig.model, data)
        for frame in rig.step(data):
            if frame.sensor == "lidar_low":
                points = frame.points_world.numpy().reshape(-1, 3)
                points = points[(points[:, 2] > LOW) & (points[:, 2] < HIGH)]  # NaN is neither
                cells = np.floor(points[:, :2] / CELL).astype(int) + 200
                inside = ((cells >= 0) & (cells < 400)).all(axis=1)
                np.add.at(hits, tuple(cells[inside].T), 1)
    grey = 255 - np.clip(hits * 60, 0, 255).astype(np.uint8)
    Image.fromarray(grey[::-1, ::-1]).save(picture)  # x up, y to the left
    print(f"{picture}: {np.count_nonzero(hits)} of {hits.size} cells of {CELL} m are occupied")


if __name__ == "__main__":
    typer.run(main)
