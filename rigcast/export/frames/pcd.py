"""A frame as a PCD point cloud, binary: one point per ray, or return, with a finite range.

Fields: `x y z` [m] and `normal_x normal_y normal_z` (float; sensor frame), `intensity` (float), `ring` (uint16) and
`column` (int32) where the frame has them, `return_number` (uint8, from 0) where rays have several, `time` (float, since
the frame's time [s]), `geom_id`, `body_id` and those of flexes, skins and props (int32). VIEWPOINT is the sensor's pose
in the world, which takes points there.
"""

from pathlib import Path

import numpy as np

from rigcast.export.fields import Fields, points_of
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.rotations import quaternion

_SCALARS = {
    "intensity": np.float32,
    "ring": np.uint16,
    "column": np.int32,
    "return_number": np.uint8,
    "geom_id": np.int32,
    "body_id": np.int32,
    "flex_id": np.int32,
    "skin_id": np.int32,
    "prop_id": np.int32,
}


def write_pcd(path: Path, frame: Frame) -> None:
    """Write the points of one frame to `path`. Raises OSError where it cannot be written."""
    from pypcd4 import Encoding, PointCloud

    columns = _columns(points_of(frame), frame.time)
    types = [column.dtype.type for column in columns.values()]
    cloud = PointCloud.from_points(list(columns.values()), list(columns), types)
    viewpoint = (*frame.pose[:3, 3].tolist(), *quaternion(frame.pose[:3, :3]).tolist())
    cloud.metadata = cloud.metadata.model_copy(update={"viewpoint": viewpoint})
    with path.open("wb") as file:
        cloud.save(file, Encoding.BINARY)


def _columns(points: Fields, time: float) -> Fields:
    vectors = (("points", ("x", "y", "z")), ("normal", ("normal_x", "normal_y", "normal_z")))
    columns = {axis: points[name][:, k] for name, axes in vectors for k, axis in enumerate(axes)}
    columns["time"] = (points["stamp"] - time).astype(np.float32)
    return columns | {name: points[name].astype(kind) for name, kind in _SCALARS.items() if name in points}
