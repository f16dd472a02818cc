"""Many worlds of one model: where their poses are, and in what they differ."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Literal

import mujoco
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.mounts import Carriers, origin
from rigcast.sensors.errors import InputError
from rigcast.sensors.scene.geoms import has_finite_pose
from rigcast.sensors.specs.mount import CARRIERS

from .differences import Differences
from .sources import Batch, Source, is_mujoco_batch, is_on_device, source_of

_POSES = {"geom": ("geom_xpos", "geom_xmat", "ngeom")} | {
    kind: (*names, count) for (kind, names), count in zip(CARRIERS.items(), ("nbody", "nsite", "ncam"), strict=True)
}
"""Of each kind of thing that has a pose: the fields of its position and rotation, and how many a model has."""


class Worlds:
    """Many worlds of one model, with what differs between them. Poses are taken as they stand at each reading.

    Args:
        batch: one of

            - a mujoco_warp `Data` on the rig's device: its arrays are used where they are, and not checked;
            - a list of MjData of the rig's model;
            - a `mujoco.batch.Batch` of it;
            - a mapping of MuJoCo's names to arrays whose first axis is the world: `geom_xpos` (nworld, ngeom, 3) [m]
              and `geom_xmat` (nworld, ngeom, 9) or (..., 3, 3); for sensors and props on bodies, sites and cameras
              `xpos` and `xmat`, `site_xpos` and `site_xmat`, `cam_xpos` and `cam_xmat` too; and `time` (nworld,) [s],
              0 if not given. Arrays on the host keep float64; Warp arrays on the rig's device are used in place.
        geom_size: (nworld, ngeom, 3) [m], as `MjModel.geom_size`, where sizes differ.
        geom_dataid: (nworld, ngeom), the mesh or height field of each geom, as `MjModel.geom_dataid`, where these
            differ; -1 leaves the geom out.
        visible: (nworld, ngeom) bool, which geoms rays may hit in each world, besides what filters say; all if not
            given.
        active: (nworld,) bool, which worlds are sensed; frames of the others are NaN, and cost nothing. An array on the
            device is read anew at each reading.
        ids: (nworld,) whole numbers from 0 on, of which each world draws its random numbers; 0, 1, 2, ... if not given.
            One world alone draws those of id 0.

    `geom_size` and `geom_dataid`, the fields of a mujoco_warp `Model`, and `visible` are read when this is made. Of a
    `mujoco.batch.Batch`, sizes given by `expand("geom_size")` count without being named here.

    Raises:
        InputError: a batch of another kind, or without worlds.

    >>> worlds = rigcast.Worlds(data, geom_size=model.geom_size, active=is_alive)
    >>> frames = rig.sense(worlds)
    """

    def __init__(
        self,
        batch: Batch,
        *,
        geom_size: ArrayLike | wp.array | None = None,
        geom_dataid: ArrayLike | wp.array | None = None,
        visible: ArrayLike | wp.array | None = None,
        active: ArrayLike | wp.array | None = None,
        ids: ArrayLike | None = None,
    ) -> None:
        self._source = source_of(batch)
        self.count = self._source.count
        if not self.count:
            raise InputError("Worlds: batch: got no world, expected one or more")
        if geom_size is None:
            geom_size = self._source.sizes()
        self.differences = Differences(
            None if geom_size is None else self._per_world("geom_size", geom_size, np.float64),
            None if geom_dataid is None else self._per_world("geom_dataid", geom_dataid, np.int32),
            None if visible is None else self._per_world("visible", visible, np.bool_),
        )
        self.ids = np.arange(self.count, dtype=np.uint32) if ids is None else self._checked_ids(ids)
        self._active = active

    def require_model(self, model: mujoco.MjModel) -> None:
        """Raise InputError if these are not worlds of this model."""
        self._source.require_model(model)
        self.differences.check(model, self.count)

    def at(self, model: mujoco.MjModel, device: wp.Device) -> "Standing":
        """These worlds as they stand now, on a device."""
        return Standing(self, self._source, model, device)

    def active(self, device: wp.Device) -> wp.array:
        """(nworld,) bool on the device, which worlds are sensed; empty if all are."""
        if self._active is None:
            return wp.empty(0, dtype=wp.bool, device=device)
        if isinstance(self._active, wp.array):
            _require_array("active", self._active, (self.count,), (wp.bool,), device)
            return self._active
        return wp.array(self._per_world("active", self._active, np.bool_), dtype=wp.bool, device=device)

    def times(self, device: wp.Device, out: wp.array | None = None) -> wp.array:
        """(nworld,) float64 [s] on the device, an array of its own."""
        given = self._source.field("time")
        times = wp.empty(self.count, dtype=wp.float64, device=device) if out is None else out
        if isinstance(given, wp.array):
            _require_array("time", given, (self.count,), (wp.float32, wp.float64), device)
            wp.utils.array_cast(given, times)
        elif given is not None:
            times.assign(self._per_world("time", given, np.float64))
        else:
            times.zero_()
        return times

    def _per_world(self, name: str, given: ArrayLike | wp.array, dtype: type) -> NDArray[Any]:
        """Values with one entry for each world; one entry alone holds in all of them, as in a mujoco_warp `Model`."""
        values = _numbers(name, given, dtype)
        if values.shape[:1] == (1,):
            values = np.broadcast_to(values, (self.count, *values.shape[1:]))
        if values.shape[:1] != (self.count,):
            raise InputError(f"Worlds: {name}: got shape {values.shape}, expected ({self.count}, ...): one per world")
        return values

    def _checked_ids(self, given: ArrayLike) -> NDArray[np.uint32]:
        ids = self._per_world("ids", given, np.int64)
        bad = np.flatnonzero((ids < 0) | (ids >= 2**32))
        if ids.ndim != 1 or bad.size:
            where = f"world {bad[0]}: got {ids[bad[0]]}" if bad.size else f"got shape {ids.shape}"
            raise InputError(f"Worlds: ids: {where}, expected ({self.count},) whole numbers from 0 to 2^32 - 1")
        return ids.astype(np.uint32)


class Standing:
    """Worlds as they stand at one reading: their poses on the device, each asked for once."""

    def __init__(self, worlds: Worlds, source: "Source", model: mujoco.MjModel, device: wp.Device) -> None:
        self.worlds, self.count, self.device = worlds, worlds.count, device
        self._source, self._model = source, model
        self._carriers: dict[str, Carriers] = {}
        self.geom_is_finite: NDArray[np.bool_] | None = None
        """(nworld, ngeom), None where poses are on the device."""

    @cached_property
    def active(self) -> wp.array:
        """(nworld,) bool, which worlds are sensed; empty if all are."""
        return self.worlds.active(self.device)

    @cached_property
    def ids(self) -> wp.array:
        """(nworld,) uint32, of which the worlds draw their random numbers."""
        return wp.array(self.worlds.ids, dtype=wp.uint32, device=self.device)

    def times(self, out: wp.array | None = None) -> wp.array:
        """(nworld,) float64 [s], an array of its own."""
        return self.worlds.times(self.device, out)

    def carriers(self, kind: Literal["geom", "body", "site", "camera", "world"]) -> Carriers:
        """The poses (nworld, n) of all geoms, bodies, sites or cameras."""
        if kind not in self._carriers:
            self._carriers[kind] = origin(self.device) if kind == "world" else self._read(kind)
        return self._carriers[kind]

    def _read(self, kind: str) -> Carriers:
        position, rotation, count = _POSES[kind]
        shape = (self.count, getattr(self._model, count))
        values = [self._source.field(name) for name in (position, rotation)]
        for name, value in zip((position, rotation), values, strict=True):
            if value is None:
                raise InputError(f"Worlds: batch: no {name!r}, which says where a sensor or prop on a {kind} is")
        read = Carriers(
            _on_device(position, values[0], shape, (wp.vec3, wp.vec3d), self.device),
            _on_device(rotation, values[1], shape, (wp.mat33, wp.mat33d), self.device),
        )
        if kind == "geom" and not any(isinstance(value, wp.array) for value in values):
            flat = np.asarray(values[0]).reshape(-1, 3), np.asarray(values[1]).reshape(-1, 9)
            self.geom_is_finite = has_finite_pose(*flat).reshape(shape)
        return read


def is_batch(data: object) -> bool:
    """Whether this is something that many worlds come from."""
    if isinstance(data, mujoco.MjData):  # first, as it is by far the fastest to tell
        return False
    return isinstance(data, Worlds | list | tuple | Mapping) or is_on_device(data) or is_mujoco_batch(data)


def as_worlds(batch: Batch) -> Worlds:
    return batch if isinstance(batch, Worlds) else Worlds(batch)


def _on_device(name: str, given: Any, shape: tuple[int, int], dtypes: tuple[type, type], device: wp.Device) -> wp.array:
    """An array of vectors or matrices, in place where it is on the device already."""
    if isinstance(given, wp.array):
        _require_array(name, given, shape, dtypes, device)
        return given
    values = _numbers(name, given, np.float64)
    expected = (*shape, 3) if dtypes[0] is wp.vec3 else (*shape, 3, 3)
    if values.shape != expected and not (len(expected) == 4 and values.shape == (*shape, 9)):
        raise InputError(f"Worlds: {name}: got shape {values.shape}, expected {expected}")
    return wp.array(np.ascontiguousarray(values.reshape(expected)), dtype=dtypes[1], device=device)


def _require_array(
    name: str, array: wp.array, shape: tuple[int, ...], dtypes: Sequence[type], device: wp.Device
) -> None:
    if array.dtype not in dtypes or tuple(array.shape) != shape:
        got = f"{tuple(array.shape)} of {array.dtype.__name__}"
        expected = f"{shape} of {' or '.join(dtype.__name__ for dtype in dtypes)}"
        raise InputError(f"Worlds: {name}: got an array {got}, expected {expected}")
    if array.device != device:
        raise InputError(f"Worlds: {name}: got an array on {array.device}, expected {device}")


def _numbers(name: str, given: ArrayLike | wp.array, dtype: type) -> NDArray[Any]:
    if isinstance(given, wp.array):
        return given.numpy().astype(dtype)
    try:
        values = np.asarray(given)
    except ValueError as error:
        raise InputError(f"Worlds: {name}: expected an array of numbers: {error}") from None
    if not np.can_cast(values.dtype, dtype, casting="same_kind"):
        raise InputError(f"Worlds: {name}: got an array of {values.dtype}, expected {np.dtype(dtype)}")
    return values.astype(dtype, copy=False)
