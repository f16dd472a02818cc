"""A frame as a PLY point cloud, binary little endian: one vertex per ray with a finite range.

Vertex properties: `x y z` [m] and `nx ny nz` (float; sensor frame), `geom_id`, `body_id` (int), `stamp`
(double, absolute time of the ray [s]); a lidar adds `ring` (ushort) and `column` (int). PLY has no notion of
a miss, so rays without a finite range are left out, and trimesh's writer has no room for comments: sensor,
time and pose of every file are in the run's frames.npz.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.exchange.ply import export_ply

from rigcast.sensors.rig.frame import Frame, LidarFrame


@dataclass(frozen=True)
class _Cloud:
    """The two attributes that trimesh's PLY writer reads of a point cloud.

    trimesh.PointCloud itself would add a colour to every vertex, and cannot be written without points.
    """

    vertices: NDArray[np.float32]
    vertex_attributes: dict[str, NDArray[Any]]


def write_ply(path: Path, frame: Frame) -> None:
    """Write the points of one frame to `path`. Raises OSError where it cannot be written."""
    hit = np.isfinite(frame.range.numpy())
    cloud = _Cloud(frame.points.numpy()[hit], _attributes(frame, hit))
    path.write_bytes(export_ply(cloud, encoding="binary_little_endian", vertex_normal=False))


def _attributes(frame: Frame, hit: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
    normal = frame.normal.numpy()[hit]
    attributes: dict[str, NDArray[Any]] = {"nx": normal[:, 0], "ny": normal[:, 1], "nz": normal[:, 2]}
    if isinstance(frame, LidarFrame):
        attributes["ring"] = frame.ring.numpy()[hit].astype(np.uint16)
        attributes["column"] = frame.column.numpy()[hit].astype(np.int32)
    attributes["geom_id"] = frame.geom_id.numpy()[hit].astype(np.int32)
    attributes["body_id"] = frame.body_id.numpy()[hit].astype(np.int32)
    attributes["stamp"] = frame.stamp.numpy()[hit].astype(np.float64)
    return attributes
