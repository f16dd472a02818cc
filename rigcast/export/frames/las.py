"""A frame as LAS 1.4 or LAZ: one point per ray, or return, with a finite range.

Point format 6. `x y z` [m] in the sensor frame, in whole steps of the smallest power of ten, from 1e-6 m up, in
which they fit; `gps_time` is the ray's stamp on the simulation's clock [s]; `classification` is 1 for what is of no
class and 63 + k for class k of the rig's `classes:` (64 to 255 are the user's in LAS); `intensity` is that of the
frame, 65535 for 1 and more; `return_number`, from 1, and `number_of_returns` count those of a ray that are written.
Extra dimensions: `normal_x normal_y normal_z` (float32), `ring`, `column`, `geom_id`, `body_id` and those of flexes,
skins and props (int32).
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigcast.export.fields import Fields, intensity_of, rays_of
from rigcast.export.ids import IdTable
from rigcast.sensors.rig.frame import Frame

if TYPE_CHECKING:
    import laspy

_EXTRA = ("ring", "column", "geom_id", "body_id", "flex_id", "skin_id", "prop_id")
_NORMALS = ("normal_x", "normal_y", "normal_z")


def write_las(path: Path, frame: Frame, ids: IdTable, compress: bool) -> None:
    """Write the points of one frame to `path`, as LAZ if `compress`. Raises OSError where it cannot be written."""
    import laspy

    rays = _with_returns(rays_of(frame))
    hit = np.isfinite(rays["range"])
    points = {name: field[hit] for name, field in rays.items()}
    with path.open("w+b") as file:
        _las_data(laspy, points, ids).write(file, do_compress=compress, laz_backend=laspy.LazBackend.Lazrs)


def _las_data(laspy: Any, points: Fields, ids: IdTable) -> "laspy.LasData":
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.generating_software = "rigcast"
    header.scales = np.full(3, _scale(points["points"]))
    extra = [name for name in _EXTRA if name in points]
    header.add_extra_dims([laspy.ExtraBytesParams(name, np.float32) for name in _NORMALS])
    header.add_extra_dims([laspy.ExtraBytesParams(name, np.int32) for name in extra])
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(points["range"]), header=header))
    las.x, las.y, las.z = points["points"].T.astype(np.float64)
    for name, value in _dimensions(points, ids).items():
        las[name] = value
    return las


def _with_returns(rays: Fields) -> Fields:
    """The rays with LAS' `return_number` and `number_of_returns`, which count the finite returns of each pulse."""
    most = 1 + int(rays["return_number"].max(initial=0)) if "return_number" in rays else 1
    hit = np.isfinite(rays["range"]).reshape(-1, most)
    number = hit.cumsum(axis=1, dtype=np.uint8)
    return rays | {"return_number": number.ravel(), "number_of_returns": number[:, -1].repeat(most)}


def _dimensions(points: Fields, ids: IdTable) -> Fields:
    classes = ids.class_of(points)
    dimensions = {
        "gps_time": points["stamp"],
        "classification": np.where(classes > 0, 63 + classes, 1).astype(np.uint8),
        "return_number": points["return_number"],
        "number_of_returns": points["number_of_returns"],
    }
    if "intensity" in points:
        dimensions["intensity"] = np.rint(intensity_of(points, white=65535, most=65535)).astype(np.uint16)
    dimensions |= {name: points["normal"][:, k] for k, name in enumerate(_NORMALS)}
    return dimensions | {name: points[name] for name in _EXTRA if name in points}


def _scale(points: NDArray[np.float32]) -> float:
    """The smallest step [m] with which coordinates fit into int32."""
    farthest = float(np.abs(points).max(initial=0.0))
    scale = 1e-6
    while farthest / scale >= 2**31 - 1:
        scale *= 10
    return scale
