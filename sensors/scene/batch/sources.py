"""Sources of the poses of many worlds."""

import operator
import sys
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.poses.mounts import BYTES_PER_FRAME
from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.scene.same_model import SHAPES, require_same_model

from .arrays import is_float32

FIELDS = ("geom_xpos", "geom_xmat", "xpos", "xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat", "time")
"""Fields read from a batch: poses of geoms, and of the bodies, sites and cameras that carry sensors and props."""

SHAPE_FIELDS = ("geom_size", "geom_dataid")


Batch: TypeAlias = Any
"""A mujoco_warp `Data`, a list of MjData, a `mujoco.batch.Batch`, or a mapping of MuJoCo's names to arrays."""
BATCHES = (
    "a mujoco_warp Data, a list of MjData, a mujoco.batch.Batch, or a mapping of names such as 'geom_xpos' to arrays"
)


class Source(Protocol):
    """A source of worlds."""

    count: int
    unset: str
    """The end of the message about a rotation of all zeros: the reason and the remedy."""

    @property
    def bytes_per_pose(self) -> int:
        """Bytes of the copies of a geom's pose; 0 if it is used in place."""

    def field(self, name: str, part: slice) -> Any:
        """A field of some of the worlds, first axis world, or Rows of all worlds; None if it does not exist."""

    def of_models(self) -> dict[str, NDArray[Any]]:
        """Those of SHAPE_FIELDS, (nworld, ngeom, ...), in which the worlds' models differ."""

    def require_model(self, model: mujoco.MjModel) -> None: ...

    @property
    def first_data(self) -> mujoco.MjData | None:
        """World 0, where worlds are MjData."""


class Rows:
    """A field of vectors or matrices of several MjData, in their own memory."""

    def __init__(self, rows: Sequence[NDArray[np.float64]]) -> None:
        self._addresses = wp.array([row.ctypes.data for row in rows], dtype=wp.uint64, device="cpu")

    def of_worlds(self, part: slice) -> wp.array:
        """Addresses (n,) uint64 of the field in some of the worlds."""
        addresses = self._addresses
        return addresses if part == slice(0, addresses.size) else addresses[part]


class _ListOfData:
    """Several MjData."""

    unset = "has not been computed, expected mj_forward or mj_kinematics first"

    def __init__(self, datas: Sequence[Any]) -> None:
        self._datas = tuple(datas)
        self._found = _found_of(self._datas)
        self.count, self.bytes_per_pose = len(datas), 2 * BYTES_PER_FRAME

    @property
    def first_data(self) -> mujoco.MjData | None:
        return self._datas[0] if self._datas else None

    def field(self, name: str, part: slice) -> Any:
        if name == "time":
            return np.array([data.time for data in self._datas[part]])
        rows = self._found.rows
        if name not in rows:
            rows[name] = Rows([getattr(data, name) for data in self._datas])
        return rows[name]

    def of_models(self) -> dict[str, NDArray[Any]]:
        return {}

    def require_model(self, model: mujoco.MjModel) -> None:
        is_other = self._found.signatures != model.signature
        if is_other.any():
            raise InputError(f"Worlds: batch[{np.argmax(is_other)}] belongs to another model than the rig")
        for k in self._found.models:
            require_same_model(f"Worlds: batch[{k}]", self._datas[k].model, model, SHAPES)


class _Found:
    """Facts about a list of MjData, valid while the same ones are given; holds no reference to them."""

    def __init__(self, datas: Sequence[Any]) -> None:
        for k, data in enumerate(datas):
            if not isinstance(data, mujoco.MjData):
                raise InputError(f"Worlds: batch[{k}]: got {type(data).__name__}, expected MjData")
        self._datas = [weakref.ref(data) for data in datas]
        self.signatures = np.array([data.signature for data in datas], np.uint64)
        self.models = {id(data.model): k for k, data in enumerate(datas)}.values()
        """One world for each distinct model."""
        self.rows: dict[str, Rows] = {}

    def is_of(self, datas: Sequence[Any]) -> bool:
        return len(datas) == len(self._datas) and all(map(operator.is_, map(operator.call, self._datas), datas))


_recent: list[_Found] = []
_MOST_RECENT = 4  # lists of MjData that are remembered, for reading several in turn


def _found_of(datas: Sequence[Any]) -> _Found:
    for found in _recent:
        if found.is_of(datas):
            return found
    found = _Found(datas)
    _recent[:] = [found, *_recent][:_MOST_RECENT]
    return found


class _MujocoBatch:
    """A `mujoco.batch.Batch`. Fields are zero until it has run once after they were asked for."""

    unset = (
        "has not been computed since it was first asked for, expected batch.forward() or batch.step() now, before "
        "the next reading"
    )

    def __init__(self, batch: Any) -> None:
        self._batch, self.count, self.bytes_per_pose = batch, batch.nsim, BYTES_PER_FRAME
        self.first_data = None

    def field(self, name: str, part: slice) -> Any:
        return self._batch.bind(name)[part]

    def of_models(self) -> dict[str, NDArray[Any]]:
        fields = {name: self._batch.expanded(name) for name in SHAPE_FIELDS}
        return {name: values for name, values in fields.items() if values is not None}

    def require_model(self, model: mujoco.MjModel) -> None:
        if self._batch.models is not None:
            raise InputError("Worlds: batch: got one with models of its own (set_models), expected worlds of one model")
        if self._batch.model.signature != model.signature:
            raise InputError("Worlds: batch belongs to another model than the rig")
        require_same_model("Worlds: batch", self._batch.model, model, SHAPES)


class _Arrays:
    """Arrays by MuJoCo's names."""

    unset = "is all zeros, expected rotation matrices"

    def __init__(self, get: Callable[[str], Any]) -> None:
        self._get, self.first_data = get, None
        position = get("geom_xpos")
        missing = [name for name in ("geom_xpos", "geom_xmat") if get(name) is None]
        if missing:
            raise InputError(f"Worlds: batch: expected 'geom_xpos' and 'geom_xmat', got no {' and no '.join(missing)}")
        if not hasattr(position, "__len__"):
            raise InputError(f"Worlds: geom_xpos: got {position!r}, expected an array (nworld, ngeom, 3)")
        self.count = len(position)

    @property
    def bytes_per_pose(self) -> int:
        given = [self._get(name) for name in ("geom_xpos", "geom_xmat")]
        if isinstance(given[0], wp.array):
            return 0
        return BYTES_PER_FRAME // 2 if all(is_float32(each) for each in given) else BYTES_PER_FRAME

    def field(self, name: str, part: slice) -> Any:
        given = self._get(name)
        if given is None or part == slice(0, self.count):
            return given
        if np.ndim(given) == 0 or len(given) != self.count:
            raise InputError(
                f"Worlds: {name}: got shape {np.shape(given)}, expected ({self.count}, ...): one per world"
            )
        return given[part]

    def of_models(self) -> dict[str, NDArray[Any]]:
        return {}

    def require_model(self, model: mujoco.MjModel) -> None:
        """Do nothing: shapes are checked when the arrays are used."""


def source_of(batch: Batch) -> Source:
    if isinstance(batch, Mapping):
        for name in batch:
            if name not in FIELDS:
                raise InputError(f"Worlds: batch: no field {name!r}, {expected_one_of(str(name), FIELDS)}")
        return _Arrays(batch.get)
    if isinstance(batch, list | tuple):
        return _ListOfData(batch)
    if is_mujoco_batch(batch):
        return _MujocoBatch(batch)
    if is_on_device(batch):
        return _Arrays(lambda name: getattr(batch, name))
    raise InputError(f"Worlds: batch: got {type(batch).__name__}, expected {BATCHES}")


def is_on_device(batch: object) -> bool:
    """Whether this is a mujoco_warp `Data`, or has its fields."""
    return isinstance(getattr(batch, "geom_xpos", None), wp.array)


def is_mujoco_batch(batch: object) -> bool:
    module = sys.modules.get("mujoco.batch")  # there from MuJoCo 4.0 on
    return module is not None and isinstance(batch, module.Batch)
