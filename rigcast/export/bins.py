"""Frames as the raw point files of KITTI and nuScenes, with the labels of SemanticKITTI and nuScenes-lidarseg.

Points are those with a finite range, in the sensor frame (x forward, z up) [m]; little endian, no header.
KITTI: float32 (n, 4) x, y, z, intensity; labels uint32 (n,), the class in the lower 16 bits, the body id in the upper.
nuScenes: float32 (n, 5) x, y, z, intensity, ring; labels uint8 (n,), the class.
A frame without intensity has 0 there, one without rings ring 0. Class 0 is none; ids.json names the others.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigcast.export.fields import points_of
from rigcast.export.ids import IdTable
from rigcast.sensors.rig.frame import Frame


def write_kitti(path: Path, frame: Frame) -> None:
    """Write the points of one frame, KITTI's velodyne/*.bin. Raises OSError where it cannot be written."""
    _columns(frame, ("intensity",)).tofile(path)


def write_kitti_labels(path: Path, frame: Frame, ids: IdTable) -> None:
    """Write the labels of the same points, SemanticKITTI's labels/*.label."""
    points = points_of(frame)
    classes, bodies = ids.class_of(points["geom_id"]), points["body_id"].clip(0)
    (classes.astype("<u4") | bodies.astype("<u4") << 16).astype("<u4").tofile(path)


def write_nuscenes(path: Path, frame: Frame) -> None:
    """Write the points of one frame, nuScenes' *.pcd.bin. Raises OSError where it cannot be written."""
    _columns(frame, ("intensity", "ring")).tofile(path)


def write_nuscenes_labels(path: Path, frame: Frame, ids: IdTable) -> None:
    """Write the labels of the same points, nuScenes-lidarseg's *_lidarseg.bin."""
    ids.class_of(points_of(frame)["geom_id"]).astype(np.uint8).tofile(path)


def _columns(frame: Frame, names: tuple[str, ...]) -> NDArray[np.float32]:
    points = points_of(frame)
    nothing = np.zeros(len(points["range"]))
    return np.column_stack([points["points"], *(points.get(name, nothing) for name in names)]).astype("<f4")
