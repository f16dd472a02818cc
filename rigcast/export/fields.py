"""The per-ray fields of a frame on the host, for all exporters."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rigcast.sensors.rig.frame import CameraFrame, Frame

Fields = dict[str, NDArray[Any]]

# Fields of Frame and its kinds; a frame has some of them. Lengths in metres, stamp in seconds.
_TYPES = {
    "range": np.float32,
    "points": np.float32,
    "normal": np.float32,
    "depth": np.float32,
    "depth_16bit": np.uint16,
    "intensity": np.float32,
    "ring": np.int32,
    "column": np.int32,
    "geom_id": np.int32,
    "body_id": np.int32,
    "flex_id": np.int32,
    "skin_id": np.int32,
    "prop_id": np.int32,
    "stamp": np.float64,
}
FIELD_NAMES = tuple(_TYPES)
_VECTORS = ("points", "normal")

# Fields of only some types of sensors.
_OWN = {"lidar": ("intensity", "ring", "column"), "depth_camera": ("depth", "depth_16bit", "intensity")}

# What has been brought from the device of frames that are still in use, None for what a frame does not have: several
# formats take the same fields.
_on_host: "WeakKeyDictionary[Frame, dict[str, NDArray[Any] | None]]" = WeakKeyDictionary()


def field_names(kind: str) -> list[str]:
    """The per-ray fields that frames of a type of sensor, such as "lidar", may have."""
    others = {name for names in _OWN.values() for name in names} - set(_OWN.get(kind, ()))
    return [name for name in _TYPES if name not in others]


def fields_of(frame: "Frame", names: Iterable[str] = FIELD_NAMES) -> Fields:
    """The per-ray fields in `names` that this frame has, in the frame's shapes.

    Raises InputError for a batch of worlds, because files hold frames of one world.
    """
    frame.require_one_world()
    on_host = _on_host.setdefault(frame, {})
    for name in names:
        if name not in on_host:
            on_host[name] = _fetch(frame, name)
    found = ((name, on_host[name]) for name in names)
    return {name: field for name, field in found if field is not None}


def camera_fields(frame: "CameraFrame") -> dict[str, NDArray[Any]]:
    """Parameters that map pixels to rays, and steps of `depth_16bit` to depth.

    `intrinsics` (3, 3), `depth_scale` () [m], and with a lens `distortion_model` () and `distortion`, OpenCV's order.
    """
    fields = {"intrinsics": np.asarray(frame.intrinsics), "depth_scale": np.asarray(frame.depth_scale)}
    if frame.lens is not None:
        fields |= {"distortion_model": np.asarray(frame.lens.type), "distortion": np.asarray(frame.lens.coefficients)}
    return fields


def rays_of(frame: "Frame") -> Fields:
    """The fields of `frame` with one row per ray and return, all of one length; vectors (n, 3).

    Where a ray has several returns, in the last axis of `range`, fields that are per ray are repeated and
    `return_number` (n,) uint8 counts from 0.
    """
    fields = fields_of(frame)
    shape = fields["range"].shape
    rays = {name: _spread(name, field, shape) for name, field in fields.items()}
    if _has_returns(fields):
        rays["return_number"] = np.broadcast_to(np.arange(shape[-1], dtype=np.uint8), shape).reshape(-1)
    return rays


def points_of(frame: "Frame") -> Fields:
    """The rows of `rays_of(frame)` whose range is finite."""
    rays = rays_of(frame)
    hit = np.isfinite(rays["range"])
    return {name: field[hit] for name, field in rays.items()}


def intensity_of(rays: Fields, white: float, most: float) -> NDArray[np.float32]:
    """The intensity (n,) in a format's units: `white` for 1, a white surface facing the sensor; at most `most`.

    All 0 if the frame has no intensity.
    """
    intensity = rays.get("intensity", np.zeros(len(rays["range"]), np.float32))
    return np.clip(white * intensity, 0, most).astype(np.float32)


def _fetch(frame: "Frame", name: str) -> NDArray[Any] | None:
    value = getattr(frame, name, None)
    return None if value is None else np.ascontiguousarray(value.numpy(), dtype=_TYPES[name])


def _has_returns(fields: Fields) -> bool:
    """Whether the last axis is that of several returns: ring and column are constant along it."""
    shape = fields["range"].shape
    if any(field.ndim < len(shape) for field in fields.values()):
        return True
    named = [fields[name] for name in ("ring", "column") if name in fields]
    return len(named) == 2 and shape[-1] > 1 and all((index == index[..., :1]).all() for index in named)


def _spread(name: str, field: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    if name in _VECTORS:
        return field.reshape(-1, 3)
    if field.ndim < len(shape):
        field = np.broadcast_to(field[..., None], shape)
    return field.reshape(-1)
