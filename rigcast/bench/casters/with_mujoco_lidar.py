"""MuJoCo-LiDAR's Warp backend with its BVH, on the CPU. It reports distances only."""

from collections.abc import Sequence
from importlib.metadata import version

import mujoco
import numpy as np
from mujoco_lidar.core_warp.mjlidar_warp import MjLidarWarp

from rigcast.sensors.specs.pattern import azimuth_elevation

from .caster import EVERY_GROUP, Answer, Cast, Floats

CUTOFF = 1e6  # [m]; its default of 100 m would turn hits into misses


class MujocoLidar:
    name = "MuJoCo-LiDAR"
    version = version("mujoco-lidar")

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int] = EVERY_GROUP) -> None:
        seen = np.isin(EVERY_GROUP, groups)
        self._lidar = MjLidarWarp(model, cutoff_dist=CUTOFF, geomgroup=seen, device="cpu", use_bvh=True)
        self._data = data

    def aim(self, origins: Floats, directions: Floats) -> Cast:
        """Rays of one origin in one call, by their angles; else one ray per call, along the x axis of its own pose."""
        if origins.ndim == 1:
            pose = np.eye(4)
            pose[:3, 3] = origins
            angles = azimuth_elevation(directions)
            return lambda: self._cast([pose], angles)
        poses = [_looking(start, towards) for start, towards in zip(origins, directions, strict=True)]
        ahead = np.zeros(1), np.zeros(1)
        return lambda: self._cast(poses, ahead)

    def _cast(self, poses: Sequence[Floats], angles: tuple[Floats, Floats]) -> Answer:
        self._lidar.update(self._data)
        distances = []
        for pose in poses:
            self._lidar.trace_rays(pose, *angles)
            distances.append(self._lidar.get_distances().copy())
        distance = np.concatenate(distances)
        return Answer(np.where(distance < 0, np.inf, distance), geom_id=None, normal=None)


def _looking(start: Floats, towards: Floats) -> Floats:
    """Return the pose (4, 4) of a frame at `start` whose x axis is the direction `towards`."""
    side = np.cross(towards, np.eye(3)[np.argmin(np.abs(towards))])
    side /= np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([towards, side, np.cross(towards, side)], axis=1), start
    return pose


CASTER = MujocoLidar
