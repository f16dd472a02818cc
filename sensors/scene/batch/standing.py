"""Many worlds as they stand at one reading, on a device."""

from functools import cached_property, lru_cache
from typing import Any

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.mounts import Carriers, origin
from rigcast.sensors.captured import require_on_device
from rigcast.sensors.errors import InputError
from rigcast.sensors.scene.geoms import has_finite_pose
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.mount import CARRIERS
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .arrays import poses, require_array
from .attached import Attached
from .per_world import PerWorld
from .worlds import Worlds

_POSES = {"geom": ("geom_xpos", "geom_xmat", "ngeom")} | {
    kind: (*names, count) for (kind, names), count in zip(CARRIERS.items(), ("nbody", "nsite", "ncam"), strict=True)
}
"""Of each kind of thing that has a pose: the fields of its position and rotation, and how many a model has."""
_DEVICE_TYPES: dict[str, tuple[tuple[int, ...], tuple[type, type]]] = {
    "position": ((3,), (wp.vec3, wp.vec3d)),
    "rotation": ((3, 3), (wp.mat33, wp.mat33d)),
}


class Standing:
    """Their poses on the device, each asked for once. Those on the host are copied, of carriers only what is used."""

    def __init__(self, worlds: Worlds, model: mujoco.MjModel, device: wp.Device) -> None:
        self.worlds, self.count, self.device = worlds, worlds.count, device
        self._model = model
        self._carriers: dict[tuple[str, bytes], Carriers] = {}
        self.geom_is_finite: NDArray[np.bool_] | None = None
        """(nworld, ngeom), None where poses are on the device."""

    @cached_property
    def active(self) -> wp.array:
        """(nworld,) bool, which worlds are sensed; empty if all are."""
        return self.worlds.active(self.device)

    @cached_property
    def ids(self) -> wp.array:
        """(nworld,) uint32, of which the worlds draw their random numbers."""
        return _uploaded_ids(self.worlds.ids.tobytes(), self.device.alias)

    def times(self, out: wp.array | None = None) -> wp.array:
        """(nworld,) float64 [s], an array of its own."""
        return self.worlds.times(self.device, out)

    def filter_of(self, spec: SensorSpec) -> Filter | PerWorld[Filter]:
        """What a sensor may see: as the worlds say, or else as it says itself."""
        return self.worlds.filters.get(spec.name, spec.filter)

    def attached(self, spec: SensorSpec, own: Attached) -> Attached:
        """Where a sensor is mounted: as the worlds say, or else as it says itself."""
        return self.worlds.attached(spec, self._model, self.device) or own

    @cached_property
    def geoms(self) -> Carriers:
        """The poses (nworld, ngeom) of all geoms."""
        position, rotation = self._values("geom")
        if isinstance(position, np.ndarray) and isinstance(rotation, np.ndarray):
            flat = position.reshape(-1, 3), rotation.reshape(-1, 9)
            self.geom_is_finite = has_finite_pose(*flat).reshape(position.shape[:2])
        return self._uploaded("geom", position, rotation)

    def carriers(self, attached: Attached) -> Carriers:
        """The poses of what carries this: of all of its kind (nworld, n), or of this alone (nworld, 1)."""
        key = attached.kind, attached.which.tobytes()
        if key not in self._carriers:
            self._carriers[key] = origin(self.device) if attached.kind == "world" else self._read(attached)
        return self._carriers[key]

    def _read(self, attached: Attached) -> Carriers:
        # those of one world have the shape (n, ...), where the first axis of a copy is the world's
        worlds = np.arange(self.count)
        which = np.broadcast_to(attached.which, self.count)
        values = [v[worlds, which, None] if isinstance(v, np.ndarray) else v for v in self._values(attached.kind)]
        return self._uploaded(attached.kind, *values)

    def _values(self, kind: str) -> list[Any]:
        """Position and rotation of all things of a kind, checked: Warp arrays, or copies on the host."""
        *names, count = _POSES[kind]
        shape = (self.count, getattr(self._model, count))
        values = []
        for name, (axes, dtypes) in zip(names, _DEVICE_TYPES.values(), strict=True):
            value = self.worlds.field(name)
            if value is None:
                raise InputError(f"Worlds: batch: no {name!r}, which says where a sensor or prop on a {kind} is")
            if isinstance(value, wp.array):
                require_array(name, value, shape, dtypes, self.device)
            else:
                value = poses(name, value, (*shape, *axes))
            values.append(value)
        on_host = [isinstance(value, np.ndarray) for value in values]
        if any(on_host) and not all(on_host):
            raise InputError(f"Worlds: {', '.join(names)}: got one on the host, expected both there or on the device")
        if all(on_host):
            self.worlds.require_set(names[1], values[1])
        return values

    def _uploaded(self, kind: str, position: Any, rotation: Any) -> Carriers:
        """On the device, in one precision."""
        if isinstance(position, np.ndarray):
            require_on_device(f"Worlds: {_POSES[kind][0]}", "an array on the host", self.device)
            is_double = np.float64 in (position.dtype, rotation.dtype)
            vector, matrix = (dtypes[is_double] for _, dtypes in _DEVICE_TYPES.values())
            position = wp.array(position, dtype=vector, device=self.device)
            rotation = wp.array(rotation, dtype=matrix, device=self.device)
        kinds = position.dtype, rotation.dtype
        if kinds not in ((wp.vec3, wp.mat33), (wp.vec3d, wp.mat33d)):
            names, got = ", ".join(_POSES[kind][:2]), " and ".join(each.__name__ for each in kinds)
            raise InputError(f"Worlds: {names}: got arrays of {got}, expected both in one precision")
        return Carriers(position, rotation)


@lru_cache(maxsize=8)
def _uploaded_ids(ids: bytes, device: str) -> wp.array:
    return wp.array(np.frombuffer(ids, np.uint32), dtype=wp.uint32, device=device)
