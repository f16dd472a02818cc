"""Checks of users' rays, and their transfer to the device."""

from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.rays.unit import as_double, unit_directions
from rigcast.sensors.captured import require_on_device
from rigcast.sensors.errors import InputError


class GivenRays(NamedTuple):
    """The n rays of this shape on the device: unit directions (n,) vec3d, and origins likewise or (1,) [m].

    vectors: (n,) vec3d of any length, which the cast will normalise into `directions`; see Rays.
    unseen: the user's origins and directions on the host, if they have not been checked yet.
    """

    directions: wp.array
    origins: wp.array
    shape: tuple[int, ...]
    vectors: wp.array | None
    unseen: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def refuse_lost(self, distance: wp.array) -> None:
        """Raise InputError for the first unchecked ray whose distance is NaN, as it could not be cast."""
        if self.unseen is not None and np.isnan(distance.numpy()).any():
            _require_castable(*self.unseen)


def take_rays(origins: ArrayLike | wp.array, directions: ArrayLike | wp.array, device: wp.Device) -> GivenRays:
    """Check rays and bring them to the device; see `Scene.cast`.

    Rays on the host are checked before they are copied to another device; on the CPU, where they are used in place,
    the cast does so.
    """
    if isinstance(directions, wp.array):
        return _device_rays(origins, directions, device)
    require_on_device("Scene.cast: directions", "an array on the host", device)
    given = _host_rays(origins, directions)
    if not device.is_cpu:
        _require_castable(*given)
    o, d = given
    unseen = given if device.is_cpu else None
    return _of_any_length(lend(d, device), lend(o, device), d.shape[:-1])._replace(unseen=unseen)


def upload(vectors: NDArray[np.float64], device: wp.Device) -> wp.array:
    """Copy vectors (..., 3) to (n,) vec3d on the device."""
    return wp.array(np.ascontiguousarray(vectors).reshape(-1, 3), dtype=wp.vec3d, device=device)


def lend(vectors: NDArray[np.float64], device: wp.Device) -> wp.array:
    """`upload`, without a copy on the CPU."""
    return wp.array(np.ascontiguousarray(vectors).reshape(-1, 3), dtype=wp.vec3d, device=device, copy=False)


def _device_rays(origins: ArrayLike | wp.array, directions: wp.array, device: wp.Device) -> GivenRays:
    if not isinstance(origins, wp.array):
        require_on_device("Scene.cast: origins", "an array on the host", device)
        host_origins = _vectors("origins", origins)
        _require_origins(host_origins)
        origins = upload(host_origins, device).reshape(host_origins.shape[:-1] or (1,))
    for name, array in (("origins", origins), ("directions", directions)):
        _require_vectors(name, array, device)
    shape = _shape_of_rays((*origins.shape, 3), (*directions.shape, 3))[:-1]
    of_each = (_repeated(directions, shape), origins if origins.size == 1 else _repeated(origins, shape))
    d, o = (as_double(array.contiguous().flatten()) for array in of_each)
    return _of_any_length(d, o, shape)


def _repeated(array: wp.array, shape: tuple[int, ...]) -> wp.array:
    """The array broadcast to this shape."""
    if array.shape == shape:
        return array
    own = [0 if n == 1 else stride for n, stride in zip(array.shape, array.strides, strict=True)]
    strides = (*[0] * (len(shape) - len(own)), *own)
    # a copy, because the view does not keep the array's memory alive
    return wp.array(ptr=array.ptr, dtype=array.dtype, shape=shape, strides=strides, device=array.device).contiguous()


def _of_any_length(vectors: wp.array, origins: wp.array, shape: tuple[int, ...]) -> GivenRays:
    if vectors.device.is_cpu:
        return GivenRays(wp.empty_like(vectors), origins, shape, vectors)
    return GivenRays(unit_directions(vectors), origins, shape, None)


def _require_vectors(name: str, array: wp.array, device: wp.Device) -> None:
    if array.dtype not in (wp.vec3, wp.vec3d):
        raise InputError(f"Scene.cast: {name}: got an array of {array.dtype.__name__}, expected vec3 or vec3d")
    if array.device != device:
        raise InputError(f"Scene.cast: {name}: got an array on {array.device}, expected {device}")


def _host_rays(origins: ArrayLike | wp.array, directions: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origins and directions in float64 and in the shape of the rays; a single origin stays (3,)."""
    d, o = _vectors("directions", directions), _vectors("origins", origins)
    if o.shape in ((3,), d.shape):
        return o, d
    shape = _shape_of_rays(o.shape, d.shape)
    return (o.reshape(3) if o.size == 3 else np.broadcast_to(o, shape)), np.broadcast_to(d, shape)


def _shape_of_rays(origins: tuple[int, ...], directions: tuple[int, ...]) -> tuple[int, ...]:
    """The common shape (..., 3) of origins and directions, by numpy's broadcasting."""
    try:
        return np.broadcast_shapes(origins, directions)
    except ValueError:
        expected = f"(3,) or what can be broadcast with that of directions, {directions}"
        raise InputError(f"Scene.cast: origins: got shape {origins}, expected {expected}") from None


def _require_castable(o: NDArray[np.float64], d: NDArray[np.float64]) -> None:
    _require_origins(o)
    _refuse_rays("directions", d, np.isfinite(d), "finite numbers")
    _refuse_rays("directions", d, (d != 0.0).any(axis=-1, keepdims=True), "a direction of any length but 0")


def _require_origins(o: NDArray[np.float64]) -> None:
    _refuse_rays("origins", o, np.abs(o) <= FARTHEST, f"finite numbers up to {FARTHEST:g} m")


def _refuse_rays(name: str, values: NDArray[np.float64], good: NDArray[np.bool_], expected: str) -> None:
    """Raise InputError for the first ray for which `good`, (..., 3) or (..., 1), is False."""
    if not good.all():
        ray = tuple(int(i) for i in np.argwhere(~good)[0, :-1])
        index = ray[0] if len(ray) == 1 else ray
        where = f"ray {index}: " if ray else ""
        raise InputError(f"Scene.cast: {where}{name}: got {values[ray].tolist()}, expected {expected}")


def _vectors(name: str, values: ArrayLike | wp.array) -> NDArray[np.float64]:
    try:
        array = values.numpy() if isinstance(values, wp.array) else np.asarray(values)
    except (TypeError, ValueError) as error:  # TypeError: a tensor of torch on a GPU
        raise InputError(f"Scene.cast: {name}: expected an array of numbers (..., 3): {error}") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"Scene.cast: {name}: expected an array of numbers (..., 3), got {array.dtype} {values!r:.80}")
    if array.ndim == 0 or array.shape[-1] != 3:
        raise InputError(f"Scene.cast: {name}: got shape {array.shape}, expected (..., 3)")
    return array.astype(np.float64, copy=False)
