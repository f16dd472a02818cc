"""Where the poses of many worlds come from."""

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of

FIELDS = ("geom_xpos", "geom_xmat", "xpos", "xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat", "time")
"""What is asked of a batch: poses of geoms, and of the bodies, sites and cameras that carry sensors and props."""


Batch: TypeAlias = Any
"""A mujoco_warp `Data`, a list of MjData, a `mujoco.batch.Batch`, or a mapping of MuJoCo's names to arrays."""


class Source(Protocol):
    """Where worlds come from."""

    count: int

    def field(self, name: str) -> Any:
        """An array whose first axis is the world, None where there is none of this name."""

    def sizes(self) -> NDArray[np.float64] | None:
        """(nworld, ngeom, 3) sizes of geoms, None where they are the model's."""

    def require_model(self, model: mujoco.MjModel) -> None: ...


class _ListOfData:
    """Several MjData."""

    def __init__(self, datas: Sequence[object]) -> None:
        for k, data in enumerate(datas):
            if not isinstance(data, mujoco.MjData):
                raise InputError(f"Worlds: batch[{k}]: got {type(data).__name__}, expected MjData")
        self._datas = datas
        self.count = len(datas)

    def field(self, name: str) -> Any:
        return np.array([getattr(data, name) for data in self._datas])

    def sizes(self) -> None:
        return None

    def require_model(self, model: mujoco.MjModel) -> None:
        for k, data in enumerate(self._datas):
            if data.signature != model.signature:  # type: ignore[attr-defined]
                raise InputError(f"Worlds: batch[{k}] belongs to another model than the rig")


class _MujocoBatch:
    """A `mujoco.batch.Batch`. Fields are zero until it has run once after they were asked for."""

    def __init__(self, batch: Any) -> None:
        self._batch, self.count = batch, batch.nsim

    def field(self, name: str) -> Any:
        values = self._batch.bind(name)
        if name.endswith("xmat"):
            missing = np.flatnonzero(~values.reshape(self.count, -1).any(axis=1))
            if values.size and missing.size:
                raise InputError(
                    f"Worlds: batch: {name} of world {missing[0]} has not been worked out since it was first asked "
                    "for, expected batch.forward() or batch.step() now, before the next reading"
                )
        return values

    def sizes(self) -> NDArray[np.float64] | None:
        return self._batch.expanded("geom_size")

    def require_model(self, model: mujoco.MjModel) -> None:
        if self._batch.models is not None:
            raise InputError("Worlds: batch: got one with models of its own (set_models), expected worlds of one model")
        if self._batch.model.signature != model.signature:
            raise InputError("Worlds: batch belongs to another model than the rig")


class _Arrays:
    """Arrays by MuJoCo's names."""

    def __init__(self, get: Callable[[str], Any]) -> None:
        self._get = get
        position = get("geom_xpos")
        if position is None or get("geom_xmat") is None:
            raise InputError("Worlds: batch: expected 'geom_xpos' and 'geom_xmat', got none")
        self.count = len(position)

    def field(self, name: str) -> Any:
        return self._get(name)

    def sizes(self) -> None:
        return None

    def require_model(self, model: mujoco.MjModel) -> None:
        """Shapes tell, when the arrays are used."""


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
    raise InputError(
        f"Worlds: batch: got {type(batch).__name__}, expected a mujoco_warp Data, a list of MjData, a "
        "mujoco.batch.Batch, or a mapping of names such as 'geom_xpos' to arrays"
    )


def is_on_device(batch: object) -> bool:
    """Whether this is a mujoco_warp `Data`, or has its fields."""
    return isinstance(getattr(batch, "geom_xpos", None), wp.array)


def is_mujoco_batch(batch: object) -> bool:
    module = sys.modules.get("mujoco.batch")  # there from MuJoCo 4.0 on
    return module is not None and isinstance(batch, module.Batch)
