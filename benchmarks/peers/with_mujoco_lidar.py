"""MuJoCo-LiDAR's Warp backend with its BVH, on the CPU. It reports distances only."""

import importlib.metadata

import mujoco
import numpy as np
from mujoco_lidar.core_warp.mjlidar_warp import MjLidarWarp

from peers.answer import Answer, Caster, Floats

CUTOFF = 1e6  # [m]; its default of 100 m would make misses of hits


def cast(model: mujoco.MjModel, data: mujoco.MjData, origins: Floats, directions: Floats) -> Answer:
    """Cast one ray per call, along the x axis of a sensor turned towards it: a call has one sensor pose."""
    lidar = MjLidarWarp(model, cutoff_dist=CUTOFF, device="cpu", use_bvh=True)
    lidar.update(data)
    ahead = np.zeros(1, np.float32)
    distance = np.empty(len(origins))
    pose = np.eye(4)
    for i, (start, towards) in enumerate(zip(origins, directions, strict=True)):
        pose[:3, :3], pose[:3, 3] = _looking(towards), start
        lidar.trace_rays(pose, ahead, ahead)
        distance[i] = lidar.get_distances()[0]
    return Answer(np.where(distance < 0, np.inf, distance), geom_id=None, normal=None)


def _looking(towards: Floats) -> Floats:
    """Return a rotation (3, 3) whose x axis is the direction."""
    side = np.cross(towards, np.eye(3)[np.argmin(np.abs(towards))])
    side /= np.linalg.norm(side)
    return np.stack([towards, side, np.cross(towards, side)], axis=1)


CASTER = Caster("MuJoCo-LiDAR", importlib.metadata.version("mujoco-lidar"), cast)
