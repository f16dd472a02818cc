"""The fields of a PointCloud2 as the drivers of Velodyne, Ouster, Livox and Hesai lay them out, and all of ours.

                                                                       times                  points
    velodyne  x y z intensity f32, ring u16, time f32                  s since the header     hits, as fired
    ouster    x y z intensity f32, t u32, reflectivity u16, ring u16,  ns since the header    all, rows x columns,
              ambient u16, range u32 [mm]                                                     destaggered
    livox     x y z intensity f32, tag u8, line u8, timestamp f64      ns, absolute           hits, as fired
    hesai     x y z intensity f32, ring u16, timestamp f64             s, absolute            hits, as fired
    full      x y z normal_x normal_y normal_z range f32, every other  s, absolute            all, as in the frame
              field that the frame has, timestamp f64
    pixels    x y z f32, of depth cameras, as depth_image_proc has it                         all, rows x columns

x, y, z are NaN where nothing was hit; range is 0 there in Ouster's integer millimetres. `tag` holds the number of
the return in bits 4 and 5, as livox_ros_driver2 has it. In the fields of makers a white surface that faces the
sensor has the intensity 100 (Velodyne, Ouster, Hesai: per cent of reflectivity) or 150 (Livox), at most 255; a frame
without intensity has 0 there. `reflectivity` is the same, rounded; `ambient`, which nothing here measures, 0.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigcast.export.fields import Fields, fields_of, intensity_of, rays_of
from rigcast.export.options import PointLayout
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.sensor_spec import SensorSpec

_XYZI = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]
_PIXEL = np.dtype(_XYZI[:3])
_MAKERS = {
    "velodyne": np.dtype([*_XYZI, ("ring", "<u2"), ("time", "<f4")]),
    "livox": np.dtype([*_XYZI, ("tag", "u1"), ("line", "u1"), ("timestamp", "<f8")]),
    "hesai": np.dtype([*_XYZI, ("ring", "<u2"), ("timestamp", "<f8")]),
    # with the gap and the end of PCL's aligned points, as ouster_ros sends it
    "ouster": np.dtype(
        {
            "names": ["x", "y", "z", "intensity", "t", "reflectivity", "ring", "ambient", "range"],
            "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "<u2", "<u2", "<u4"],
            "offsets": [0, 4, 8, 16, 20, 24, 26, 28, 32],
            "itemsize": 48,
        }
    ),
}
_FULL = ["x", "y", "z", "normal_x", "normal_y", "normal_z", "range"]
_FULL_INTEGERS = {
    "return_number": "u1",
    "ring": "<u2",
    "column": "<i4",
    "geom_id": "<i4",
    "body_id": "<i4",
    "flex_id": "<i4",
    "skin_id": "<i4",
    "prop_id": "<i4",
}


class Points(NamedTuple):
    """The points of a message: a structured array (height, width), `dense` where none of them is NaN."""

    array: NDArray[np.void]
    dense: bool


def choose_layout(layout: PointLayout, preset: str | None) -> str:
    """The layout of a sensor: for "auto" that of the maker named by the preset's first word, or "full"."""
    if layout != "auto":
        return layout
    maker = "" if preset is None else preset.partition("_")[0]
    return maker if maker in _MAKERS else "full"


def lay_out(frame: Frame, layout: str, spec: SensorSpec) -> Points:
    """The points of a frame of the sensor `spec` in a layout."""
    rays = rays_of(frame)
    rays["stamp_ns"] = np.rint((rays["stamp"] - frame.time) * 1e9)
    if layout == "full":
        return Points(_full(rays).reshape(_rows_columns(frame)), False)
    if layout == "ouster":
        return Points(_destaggered(_of_maker(rays, layout).reshape(_rows_columns(frame)), spec), False)
    order = np.argsort(rays["stamp"], kind="stable")
    order = order[np.isfinite(rays["range"])[order]]
    return Points(_of_maker({name: field[order] for name, field in rays.items()}, layout)[None], True)


def lay_out_pixels(frame: CameraFrame) -> Points:
    """The points of a camera, rows x columns, x y z alone."""
    points = np.ascontiguousarray(fields_of(frame, ["points"])["points"], "<f4")
    return Points(points.view(_PIXEL)[..., 0], False)


def _rows_columns(frame: Frame) -> tuple[int, int]:
    """(beams, columns), or (1, rays); several returns stand side by side."""
    shape = fields_of(frame)["range"].shape
    return (shape[0], -1) if len(shape) > 1 else (1, shape[0])


def _destaggered(cloud: NDArray[np.void], spec: SensorSpec) -> NDArray[np.void]:
    """A turn (rows, columns) with each row shifted by its azimuth offset, so that a column is at one azimuth.

    A row that looks n columns ahead sees in column k what the other rows see in column k + n. So does ouster_ros by
    default. Sectors stay as they are, because what leaves them at one end is not what enters at the other.
    """
    if not isinstance(spec, Lidar) or spec.azimuth_offset_deg is None or spec.azimuth_deg is not None:
        return cloud
    rows = len(spec.azimuth_offset_deg)
    by_return = cloud.reshape(rows, -1, 2 if spec.returns == "dual" else 1)
    columns = by_return.shape[1]
    step = (-360 if spec.clockwise else 360) / columns
    ahead = np.rint(np.array(spec.azimuth_offset_deg) / step).astype(int)
    source = (np.arange(columns) - ahead[:, None]) % columns
    return np.take_along_axis(by_return, source[..., None], axis=1).reshape(rows, -1)


def _of_maker(rays: Fields, layout: str) -> NDArray[np.void]:
    nothing = np.zeros(len(rays["range"]), np.int32)
    intensity = intensity_of(rays, white=150 if layout == "livox" else 100, most=255)
    ring = rays.get("ring", nothing)
    values: dict[str, Any] = {
        **dict(zip("xyz", rays["points"].T, strict=True)),
        "intensity": intensity,
        "ring": ring,
        "line": ring,
        "time": 1e-9 * rays["stamp_ns"],
        "timestamp": rays["stamp"] if layout == "hesai" else np.rint(1e9 * rays["stamp"]),
        "tag": rays.get("return_number", nothing) << 4,
        "t": rays["stamp_ns"],
        "reflectivity": np.rint(intensity),
        "ambient": nothing,
        "range": np.where(np.isfinite(rays["range"]), np.rint(1000.0 * rays["range"]), 0),
    }
    return _filled(_MAKERS[layout], values)


def _full(rays: Fields) -> NDArray[np.void]:
    measured = [*_FULL, *(["intensity"] if "intensity" in rays else [])]
    integers = {name: kind for name, kind in _FULL_INTEGERS.items() if name in rays}
    dtype = np.dtype([*((name, "<f4") for name in measured), *integers.items(), ("timestamp", "<f8")])
    vectors = np.concatenate([rays["points"], rays["normal"]], axis=1).T
    return _filled(dtype, rays | dict(zip(_FULL[:6], vectors, strict=True)) | {"timestamp": rays["stamp"]})


def _filled(dtype: np.dtype[np.void], values: Fields) -> NDArray[np.void]:
    array = np.zeros(len(values["x"]), dtype)
    for name in dtype.names or ():
        array[name] = values[name]
    return array
