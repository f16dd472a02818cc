"""One point cloud from many depth images: the demo's cameras, fused in the world frame, one point per voxel.

python examples/fuse_depth.py [--seconds S] [--path CLOUD.ply]
"""

from pathlib import Path

import mujoco
import numpy as np
import trimesh
import typer

import rigcast

VOXEL = 0.05  # m
RIG = Path(__file__).parent.parent / "configs" / "demo.yaml"


def main(seconds: float = 2.0, path: str = "fused.ply") -> None:
    rig = rigcast.load_rig(RIG, overrides=["sensors.front.max_range=8", "sensors.wrist.max_range=8"])
    data = mujoco.MjData(rig.model)
    mujoco.mj_resetDataKeyframe(rig.model, data, 0)
    clouds = []
    for _ in range(round(seconds / rig.model.opt.timestep)):
        mujoco.mj_step(rig.model, data)
        for frame in rig.step(data):
            if isinstance(frame, rigcast.CameraFrame):
                points = frame.points_world.numpy().reshape(-1, 3)
                clouds.append(points[np.isfinite(points).all(axis=1)])
    points = np.concatenate(clouds)
    _, first = np.unique(np.floor(points / VOXEL).astype(np.int64), axis=0, return_index=True)
    trimesh.PointCloud(points[first]).export(path)
    print(f"{path}: {len(first)} points, one per voxel of {VOXEL} m, of {len(points)} in {len(clouds)} images")


if __name__ == "__main__":
    typer.run(main)
