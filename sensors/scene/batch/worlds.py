"""Many worlds of one model: the source of their poses, and their differences."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.sensors.captured import require_as_before, require_on_device
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .arrays import numbers, require_array
from .differences import Differences
from .per_world import PerWorld, Value
from .sources import Batch, is_mujoco_batch, is_on_device, source_of
from .world_mounts import WorldMounts


class Worlds:
    """Many worlds of one model, and their differences. Poses are taken as they are at each reading.

    Args:
        batch: one of

            - a mujoco_warp `Data` on the rig's device: its arrays are used in place and not checked;
            - a list of MjData of the rig's model;
            - a `mujoco.batch.Batch` of it;
            - a mapping of MuJoCo's names to arrays whose first axis is the world: `geom_xpos` (nworld, ngeom, 3) [m]
              and `geom_xmat` (nworld, ngeom, 9) or (..., 3, 3); for sensors and props on bodies, sites and cameras
              `xpos` and `xmat`, `site_xpos` and `site_xmat`, `cam_xpos` and `cam_xmat` too; and `time` (nworld,) [s],
              0 if not given. Arrays on the host keep float64; Warp arrays on the rig's device are used in place, and
              those of geoms must be contiguous.
        geom_size: (nworld, ngeom, 3) [m], as `MjModel.geom_size`, where sizes differ.
        geom_dataid: (nworld, ngeom), the mesh or height field of each geom, as `MjModel.geom_dataid`, where these
            differ; -1 leaves the geom out.
        visible: (nworld, ngeom) bool, which geoms rays may hit in each world, besides what filters say; all if not
            given.
        filters: for each sensor name, a `Filter` per world, instead of the sensor's own.
        mounts: for each sensor name, a `Mount` per world. All mounts of a sensor must be on bodies, or all on sites,
            and so on.
        active: (nworld,) bool, which worlds are sensed; frames of the others are NaN, and cost nothing. It is read
            again at each reading, so it may be written to in between.
        ids: (nworld,) integers from 0 on; each world draws the random numbers of its id. 0, 1, 2, ... if not given. A
            single world draws those of id 0.

    Everything except poses, times and `active` is read once; do not write to these arrays later. `geom_size` and
    `geom_dataid` are the fields of a mujoco_warp `Model`. Fields that `expand` gave to a `mujoco.batch.Batch` are used
    without being passed here.

    Raises:
        InputError: a batch of another kind or without worlds, or other than one of something for each world (of
            `active` when it is read). What depends on the model is checked at the first reading.

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
        filters: Mapping[str, Sequence[Filter]] | None = None,
        mounts: Mapping[str, Sequence[Mount]] | None = None,
        active: ArrayLike | wp.array | None = None,
        ids: ArrayLike | None = None,
    ) -> None:
        self._source = source_of(batch)
        self.count = self._source.count
        if not self.count:
            raise InputError("Worlds: batch: got no world, expected one or more")
        of_models = self._source.of_models()
        geom_size = of_models.get("geom_size") if geom_size is None else geom_size
        geom_dataid = of_models.get("geom_dataid") if geom_dataid is None else geom_dataid
        self.differences = Differences(
            None if geom_size is None else self._per_world("geom_size", geom_size, np.float64),
            None if geom_dataid is None else self._per_world("geom_dataid", geom_dataid, np.int32),
            None if visible is None else self._per_world("visible", visible, np.bool_),
        )
        self.filters = self._per_sensor("filters", filters, Filter)
        self.mounts = self._per_sensor("mounts", mounts, Mount)
        for sensor, each in self.mounts.items():
            _require_one_kind(sensor, each)
        self.ids = np.arange(self.count, dtype=np.uint32) if ids is None else self._checked_ids(ids)
        self._active = active
        self._fits: mujoco.MjModel | None = None  # the one against which filters, mounts and differences were checked
        self._bound: dict[str, tuple[SensorSpec, WorldMounts]] = {}

    def __repr__(self) -> str:
        of_geoms = self.differences
        options: dict[str, Any] = {
            "geom_size": of_geoms.size,
            "geom_dataid": of_geoms.dataid,
            "visible": of_geoms.visible,
        }
        options |= {"filters": self.filters or None, "mounts": self.mounts or None, "active": self._active}
        given = ", ".join(name for name, values in options.items() if values is not None)
        return f"Worlds({self.count}; {given})" if given else f"Worlds({self.count})"

    def require_model(self, model: mujoco.MjModel) -> None:
        """Raise InputError if these are not worlds of this model."""
        self._source.require_model(model)
        if self._fits is model:
            return
        self.differences.check(model, self.count)
        for option, given in (("filters", self.filters), ("mounts", self.mounts)):
            for sensor, values in given.items():
                values.check(f"Worlds: {option}: {sensor!r}", model)
        self._fits, self._bound = model, {}

    def require_sensors(self, names: Collection[str]) -> None:
        """Raise InputError if filters or mounts are given for a sensor of another name."""
        for option, given in (("filters", self.filters), ("mounts", self.mounts)):
            for sensor in given.keys() - names:
                raise InputError(f"Worlds: {option}: no sensor {sensor!r}, {expected_one_of(sensor, list(names))}")

    @property
    def first_data(self) -> mujoco.MjData | None:
        """World 0, where worlds are MjData and all of them are sensed."""
        return self._source.first_data if self._active is None else None

    @property
    def bytes_per_pose(self) -> int:
        """Bytes of the copies of a geom's pose; 0 if it is used in place."""
        return self._source.bytes_per_pose

    def differ_in_sight(self, sensor: str) -> bool:
        """Whether a sensor may see different geoms in different worlds."""
        given = self.differences.visible is not None or self.differences.dataid is not None
        return given or sensor in self.filters

    @property
    def all(self) -> slice:
        return slice(0, self.count)

    def parts(self, most: int) -> list[slice]:
        """Slices of all worlds, of equal length, at most `most` but at least one; the last may overlap."""
        size = -(-self.count // -(-self.count // max(most, 1)))
        firsts = [min(first, self.count - size) for first in range(0, self.count, size)]
        return [slice(first, first + size) for first in firsts]

    def field(self, name: str, part: slice) -> Any:
        """A field of some of the worlds as they stand; None if there is none of this name."""
        return self._source.field(name, part)

    def require_set(self, name: str, rotation: NDArray[Any], part: slice) -> None:
        """Raise InputError if rotations (n, m, 3, 3) of some of the worlds are all zeros in an active world."""
        if rotation.size == 0 or rotation[:, 0].any(axis=(1, 2)).all():
            return
        is_unset = ~rotation.any(axis=(1, 2, 3))
        if self._active is not None and not isinstance(self._active, wp.array):
            is_unset &= self._one_each("active", self._active, np.bool_)[part]
        if is_unset.any():
            world = part.start + int(np.argmax(is_unset))
            raise InputError(f"Worlds: batch: {name} of world {world} {self._source.unset}")

    def filter_of(self, spec: SensorSpec) -> Filter | PerWorld[Filter]:
        """The filter of a sensor: that given by these worlds, else its own."""
        return self.filters.get(spec.name, spec.filter)

    def mounts_of(self, spec: SensorSpec, model: mujoco.MjModel, device: wp.Device) -> WorldMounts | None:
        """The mounts of a sensor in each world; None if the worlds give none."""
        mounts = self.mounts.get(spec.name)
        if mounts is None:
            return None
        known, bound = self._bound.get(spec.name, (None, None))
        if bound is None or known is not spec or bound.on.which.device != device:
            require_as_before(f"Worlds: mounts: {spec.name!r}: got those of a new Worlds", device)
            each = [mount.bind(model).turned(spec.frame_rotation) for mount in mounts.values]
            bound = WorldMounts.by([each[k] for k in mounts.of_world], device)
            self._bound[spec.name] = spec, bound
        return bound

    def active(self, device: wp.Device, part: slice) -> wp.array | None:
        """Which of some of the worlds are sensed, (n,) bool on the device; None if all are."""
        if self._active is None:
            return None
        if isinstance(self._active, wp.array):
            require_array("active", self._active, (self.count,), (wp.bool,), device)
            return self._active if part == self.all else self._active[part]
        require_on_device("Worlds: active", "an array on the host", device)
        return wp.array(self._one_each("active", self._active, np.bool_)[part], dtype=wp.bool, device=device)

    def time(self, device: wp.Device, part: slice) -> wp.array | NDArray[np.float64] | None:
        """The times of some of the worlds, (n,) float32 or float64 [s], on the device or the host; None for 0."""
        given = self._source.field("time", self.all)
        if given is None:
            return None
        if isinstance(given, wp.array):
            require_array("time", given, (self.count,), (wp.float32, wp.float64), device)
            return given if part == self.all else given[part]
        require_on_device("Worlds: time", "an array on the host", device)
        return self._one_each("time", given, np.float64)[part]

    def _per_world(self, name: str, given: ArrayLike | wp.array, dtype: type) -> NDArray[Any]:
        """Values with one entry per world; a single entry holds for all worlds, as in a mujoco_warp `Model`."""
        values = numbers(name, given, dtype)
        if values.shape[:1] == (1,):
            values = np.broadcast_to(values, (self.count, *values.shape[1:]))
        if values.shape[:1] != (self.count,):
            raise InputError(f"Worlds: {name}: got shape {values.shape}, expected ({self.count}, ...): one per world")
        return values

    def _one_each(self, name: str, given: ArrayLike, dtype: type) -> NDArray[Any]:
        """(nworld,) numbers."""
        values = numbers(name, given, dtype)
        if values.shape != (self.count,):
            raise InputError(f"Worlds: {name}: got shape {values.shape}, expected ({self.count},): one per world")
        return values

    def _per_sensor(
        self, option: str, given: Mapping[str, Sequence[Value]] | None, kind: type[Value]
    ) -> dict[str, PerWorld[Value]]:
        if given is None:
            return {}
        require_type(f"Worlds: {option}", given, Mapping)
        return {
            name: PerWorld.of(f"Worlds: {option}: {name!r}", each, kind, self.count) for name, each in given.items()
        }

    def _checked_ids(self, given: ArrayLike) -> NDArray[np.uint32]:
        ids = self._one_each("ids", given, np.int64)
        bad = np.flatnonzero((ids < 0) | (ids >= 2**32))
        if bad.size:
            raise InputError(
                f"Worlds: ids: world {bad[0]}: got {ids[bad[0]]}, expected whole numbers from 0 to 2^32 - 1"
            )
        return ids.astype(np.uint32)


def is_batch(data: object) -> bool:
    """Whether this is a batch of worlds."""
    if isinstance(data, mujoco.MjData):  # first, as it is by far the fastest check
        return False
    return isinstance(data, Worlds | list | tuple | Mapping) or is_on_device(data) or is_mujoco_batch(data)


def as_worlds(batch: Batch) -> Worlds:
    return batch if isinstance(batch, Worlds) else Worlds(batch)


def _require_one_kind(sensor: str, mounts: PerWorld[Mount]) -> None:
    """Raise InputError if mounts of one sensor are on carriers of several kinds."""
    first = mounts.values[0].parent
    for k, mount in enumerate(mounts.values):
        if mount.parent != first:
            where = f"Worlds: mounts: {sensor!r}: world {mounts.of_world.index(k)}"
            raise InputError(f"{where}: got one on a {mount.parent}, expected one on a {first}, as in world 0")
