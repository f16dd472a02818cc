"""Frames as the raw point files of KITTI and nuScenes, with the labels of SemanticKITTI and nuScenes-lidarseg.

Points are those with a finite range, in the sensor frame (x forward, z up) [m]; little endian, no header.
KITTI: float32 (n, 4) x, y, z, intensity from 0 to 1; labels uint32 (n,), the class in the lower 16 bits, the body id
in the upper.
nuScenes: float32 (n, 5) x, y, z, intensity from 0 to 255, of which 100 is white, ring; labels uint8 (n,), the class.
A frame without intensity has 0 there, one without rings ring 0. Class 0 is none; ids.json names the others.
"""

from pathlib import Path

import numpy as np

from rigcast.export.fields import intensity_of, points_of
from rigcast.export.ids import IdTable
from rigcast.sensors.rig.frame import Frame


def write_kitti(path: Path, frame: Frame) -> None:
    """Write the points of one frame, KITTI's velodyne/*.bin. Raises OSError where it cannot be written."""
    points = points_of(frame)
    np.column_stack([points["points"], intensity_of(points, white=1, most=1)]).astype("<f4").tofile(path)


def write_kitti_labels(path: Path, frame: Frame, ids: IdTable) -> None:
    """Write the labels of the same points, SemanticKITTI's labels/*.label."""
    points = points_of(frame)
    classes, bodies = ids.class_of(points), points["body_id"].clip(0)
    (classes.astype("<u4") | bodies.astype("<u4") << 16).astype("<u4").tofile(path)


def write_nuscenes(path: Path, frame: Frame) -> None:
    """Write the points of one frame, nuScenes' *.pcd.bin. Raises OSError where it cannot be written."""
    points = points_of(frame)
    ring = points.get("ring", np.zeros(len(points["range"])))
    columns = [points["points"], intensity_of(points, white=100, most=255), ring]
    np.column_stack(columns).astype("<f4").tofile(path)


def write_nuscenes_labels(path: Path, frame: Frame, ids: IdTable) -> None:
    """Write the labels of the same points, nuScenes-lidarseg's *_lidarseg.bin."""
    ids.class_of(points_of(frame)).astype(np.uint8).tofile(path)
