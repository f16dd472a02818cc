"""A frame as a PLY point cloud, binary little endian: one vertex per ray, or return, with a finite range.

Vertex properties: `x y z` [m] and `nx ny nz` (float; sensor frame), `geom_id`, `body_id` (int), `stamp` (double,
absolute time of the ray [s]); a lidar adds `ring` and `column` (int), one with several returns `return_number` (uchar,
from 0), and a frame that has them `intensity` (float), `flex_id`, `skin_id`, `prop_id` (int). Integers of two bytes
are left to others: Open3D skips properties that are `ushort`, as trimesh names them.
PLY has no notion of a miss, so rays without a finite range are left out, and trimesh's writer has no room for
comments: sensor, time and pose of every file are in the run's frames.npz.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.exchange.ply import export_ply

from rigcast.export.fields import Fields, points_of
from rigcast.sensors.rig.frame import Frame


@dataclass(frozen=True)
class _Cloud:
    """The two attributes that trimesh's PLY writer reads of a point cloud.

    trimesh.PointCloud itself would add a colour to every vertex, and cannot be written without points.
    """

    vertices: NDArray[np.float32]
    vertex_attributes: dict[str, NDArray[Any]]


def write_ply(path: Path, frame: Frame) -> None:
    """Write the points of one frame to `path`. Raises OSError where it cannot be written."""
    points = points_of(frame)
    cloud = _Cloud(points["points"], _attributes(points))
    path.write_bytes(export_ply(cloud, encoding="binary_little_endian", vertex_normal=False))


def _attributes(points: Fields) -> Fields:
    normal = points["normal"]
    attributes: Fields = {"nx": normal[:, 0], "ny": normal[:, 1], "nz": normal[:, 2]}
    names = ("intensity", "ring", "column", "return_number", "geom_id", "body_id", "flex_id", "skin_id", "prop_id")
    return attributes | {name: points[name] for name in (*names, "stamp") if name in points}
