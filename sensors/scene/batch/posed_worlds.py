"""A part of many worlds with their poses at one reading."""

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.host.gather import Gathered
from rigcast.kernels.poses.mounts import Carriers, Frames, origin
from rigcast.sensors.captured import require_as_before, require_on_device
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.mount import CARRIERS
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .arrays import poses, require_array, require_no_gaps
from .sources import Rows
from .world_mounts import WorldMounts
from .worlds import Worlds

_POSES = {"geom": ("geom_xpos", "geom_xmat", "ngeom")} | {
    kind: (*names, count) for (kind, names), count in zip(CARRIERS.items(), ("nbody", "nsite", "ncam"), strict=True)
}
"""For each kind of object with a pose: MuJoCo's fields of position and rotation, and of the number of objects."""
_DEVICE_TYPES: dict[str, tuple[tuple[int, ...], tuple[type, type]]] = {
    "position": ((3,), (wp.vec3, wp.vec3d)),
    "rotation": ((3, 3), (wp.mat33, wp.mat33d)),
}


_MOST_UPLOADS = 64  # arrays that are kept


class PosedWorlds:
    """Some of many worlds, or all, with their poses at one reading.

    Poses are fetched once; for carriers on the host only those in use are copied.

    part: which of the worlds. gathered: where poses of several MjData are copied together, and uploads: where values of
    the host are copied to the device, both the same for every reading.
    """

    def __init__(
        self,
        worlds: Worlds,
        part: slice,
        model: mujoco.MjModel,
        device: wp.Device,
        gathered: dict[str, Gathered],
        uploads: dict[object, wp.array],
    ) -> None:
        self.part, self.count, self.device = part, part.stop - part.start, device
        self._worlds, self._model, self._gathered, self._uploads = worlds, model, gathered, uploads
        self._carriers: dict[tuple[str, bytes], Carriers] = {}

    @cached_property
    def active(self) -> wp.array | None:
        """(n,) bool, which of the worlds are sensed; None if all are."""
        return self._worlds.active(self.device, self.part)

    @cached_property
    def time(self) -> wp.array | None:
        """(n,) float32 or float64 [s], the time of each world; None for 0."""
        time = self._worlds.time(self.device, self.part)
        return time if time is None or isinstance(time, wp.array) else self._upload("time", time, wp.float64)

    @cached_property
    def ids(self) -> wp.array:
        """Ids (n,) uint32 that determine the random numbers of each world."""
        ids = _uploaded_ids(self._worlds.ids.tobytes(), self.device.alias)
        return ids if self.part == self._worlds.all else ids[self.part]

    def mounts_of(self, spec: SensorSpec, own: WorldMounts) -> WorldMounts:
        """The mounts of a sensor: those given by the worlds, else its own."""
        mounts = self._worlds.mounts_of(spec, self._model, self.device)
        return own if mounts is None else mounts.of_worlds(self.part)

    @cached_property
    def geoms(self) -> Sequence[NDArray[np.floating[Any]] | wp.array]:
        """The positions and rotations of all geoms: Warp arrays (n, ngeom), or (n, ngeom, 3) and (n, ngeom, 3, 3)."""
        values = self._values("geom")
        for name, value in zip(_POSES["geom"][:2], values, strict=True):
            if isinstance(value, wp.array):
                require_no_gaps(name, value)
        return values

    def shapes(self, props: Sequence[WorldMounts]) -> Sequence[NDArray[np.floating[Any]] | wp.array]:
        """The positions and rotations of all geoms, then of these props."""
        if not props:
            return self.geoms
        first = self._model.ngeom
        frames = Frames.empty(self.count, first + len(props), self.device)
        frames.copy(self._uploaded("geom", *self.geoms))
        for k, prop in enumerate(props):
            frames.place(first + k, self.carriers(prop), prop.on)
        return frames.position, frames.rotation

    def carriers(self, mounts: WorldMounts) -> Carriers:
        """The poses of carriers: of all objects of the mounts' kind (n, m), or of one per world (n, 1)."""
        key = mounts.kind, mounts.which.tobytes()
        if key not in self._carriers:
            self._carriers[key] = (
                origin(self.device)
                if mounts.kind == "world"
                else self._uploaded(key, *self._values(mounts.kind, mounts.which))
            )
        return self._carriers[key]

    def _values(self, kind: str, which: NDArray[np.int32] | None = None) -> list[Any]:
        """Position and rotation of all objects of a kind, checked, in one precision.

        They are Warp arrays or numpy arrays. which: (n,) or (1,), the one object to copy per world; None for all.
        """
        *names, count = _POSES[kind]
        shape = (self.count, getattr(self._model, count))
        values = []
        for name, (axes, dtypes) in zip(names, _DEVICE_TYPES.values(), strict=True):
            value = self._worlds.field(name, self.part)
            if value is None:
                raise InputError(f"Worlds: batch: no {name!r}, which says where a sensor or prop on a {kind} is")
            if isinstance(value, wp.array):
                require_array(name, value, shape, dtypes, self.device)
            elif isinstance(value, Rows):
                value = self._copied(name, value, axes, which)
            else:
                value = poses(name, value, (*shape, *axes))
                value = value if which is None else value[np.arange(self.count), which, None]
            values.append(value)
        on_host = [isinstance(value, np.ndarray) for value in values]
        if any(on_host) and not all(on_host):
            raise InputError(f"Worlds: {', '.join(names)}: got one on the host, expected both there or on the device")
        if not any(on_host):
            _require_one_precision(names, values)
            return values
        require_on_device(f"Worlds: {names[0]}", "an array on the host", self.device)
        self._worlds.require_set(names[1], values[1], self.part)
        precision = np.result_type(*values)
        return [value.astype(precision, copy=False) for value in values]

    def _copied(
        self, name: str, rows: Rows, axes: tuple[int, ...], which: NDArray[np.int32] | None
    ) -> NDArray[np.float64]:
        """Values (n, m, *axes) of all objects, or (n, 1, *axes) of one per world."""
        shape = (self.count, self._model.ngeom if which is None else 1, *axes)
        gathered = self._gathered.get(name)
        if gathered is None or gathered.values.shape != shape:
            gathered = self._gathered[name] = Gathered(shape)
        gathered.take(rows.of_worlds(self.part), which)
        return gathered.values

    def _uploaded(self, key: object, position: Any, rotation: Any) -> Carriers:
        if isinstance(position, wp.array):
            return Carriers(position, rotation)
        vector, matrix = (dtypes[position.dtype == np.float64] for _, dtypes in _DEVICE_TYPES.values())
        return Carriers(
            self._upload((key, "position"), position, vector), self._upload((key, "rotation"), rotation, matrix)
        )

    def _upload(self, key: object, values: NDArray[np.floating[Any]], dtype: type) -> wp.array:
        """The values on the device, in the array of the last reading that uploaded these, if it fits."""
        known = self._uploads.get(key)
        if known is None or known.dtype is not dtype or known.shape != values.shape[: known.ndim]:
            if len(self._uploads) == _MOST_UPLOADS:
                self._uploads.clear()
            known = self._uploads[key] = wp.array(values, dtype=dtype, device=self.device)
        else:
            known.assign(values)
        return known


def _require_one_precision(names: Sequence[str], values: Sequence[wp.array]) -> None:
    kinds = tuple(value.dtype for value in values)
    if kinds not in ((wp.vec3, wp.mat33), (wp.vec3d, wp.mat33d)):
        got = " and ".join(kind.__name__ for kind in kinds)
        raise InputError(f"Worlds: {', '.join(names)}: got arrays of {got}, expected both in one precision")


@lru_cache(maxsize=8)
def _uploaded_ids(ids: bytes, device: str) -> wp.array:
    require_as_before("Worlds: got other ids", wp.get_device(device))
    return wp.array(np.frombuffer(ids, np.uint32), dtype=wp.uint32, device=device)
