"""Differences between the geoms of many worlds, besides their poses."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.world.arrays import Shapes
from rigcast.sensors.errors import InputError
from rigcast.sensors.scene.parts.geoms import Geoms
from rigcast.sensors.scene.parts.model_geometry import needs_asset


@dataclass(frozen=True, eq=False)
class Differences:
    """Geoms in many worlds: size (nworld, ngeom, 3) [m], mesh or height field (nworld, ngeom), -1 for none, and
    whether rays may hit them at all (nworld, ngeom).

    None: as in the model, in all worlds.
    """

    size: NDArray[np.float64] | None = None
    dataid: NDArray[np.int32] | None = None
    visible: NDArray[np.bool_] | None = None

    def check(self, model: mujoco.MjModel, worlds: int) -> None:
        """Raise InputError if geoms of this model cannot have these values."""
        fields: tuple[tuple[str, NDArray[Any] | None, tuple[int, ...]], ...] = (
            ("geom_size", self.size, (3,)),
            ("geom_dataid", self.dataid, ()),
            ("visible", self.visible, ()),
        )
        for name, values, shape in fields:
            expected = (worlds, model.ngeom, *shape)
            if values is not None and values.shape != expected:
                raise InputError(f"Worlds: {name}: got shape {values.shape}, expected {expected}")
        if self.size is not None:
            # sizes that a type of geom does not use may be anything in the model
            is_size = ((self.size >= 0) | (self.size == model.geom_size)) & (np.abs(self.size) <= FARTHEST)
            _refuse("geom_size", ~is_size.all(axis=-1), self.size, f"0 to {FARTHEST:g} m")
        if self.dataid is not None:
            count = np.where(model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD, model.nhfield, model.nmesh)
            bad = needs_asset(model) & ((self.dataid < -1) | (self.dataid >= count))
            _refuse("geom_dataid", bad, self.dataid, "a mesh or height field of the model, or -1")

    def same_as(self, other: "Differences") -> bool:
        return self is other or all(
            a is b or (a is not None and b is not None and np.array_equal(a, b))
            for a, b in ((self.size, other.size), (self.dataid, other.dataid), (self.visible, other.visible))
        )

    @property
    def of_shapes(self) -> bool:
        """Whether shapes differ in more than their presence."""
        return self.size is not None or self.dataid is not None

    def present(self, geoms: Geoms) -> NDArray[np.bool_] | None:
        """Which geoms rays may hit in each world (nworld, ngeom); None if worlds do not differ in that."""
        if self.dataid is None:
            return self.visible
        has_asset = geoms.is_present(self.dataid)
        return has_asset if self.visible is None else has_asset & self.visible

    def shapes(self, geoms: Geoms, props: Shapes, worlds: int) -> Shapes:
        """The shapes of `worlds` worlds, world by world: geoms, then props, whose trees come after those of geoms."""
        model = geoms.model
        size = model.geom_size if self.size is None else self.size
        dataid = model.geom_dataid if self.dataid is None else self.dataid
        each = np.broadcast_to(size, (worlds, model.ngeom, 3)), np.broadcast_to(dataid, (worlds, model.ngeom))
        own = geoms.shapes_with(*each)
        tree = np.where(props.tree >= 0, props.tree + len(geoms.trees), -1).astype(np.int32)
        return Shapes(
            _world_by_world(own.kind, props.kind, worlds),
            _world_by_world(own.size, props.size, worlds),
            _world_by_world(own.tree, tree, worlds),
            _world_by_world(own.center, props.center, worlds),
            _world_by_world(own.half, props.half, worlds),
        )


def _refuse(name: str, bad: NDArray[np.bool_], values: NDArray[np.generic], expected: str) -> None:
    """Raise InputError for the first geom that is bad (nworld, ngeom)."""
    if bad.any():
        world, geom = np.argwhere(bad)[0]
        got = values[world, geom].tolist()
        raise InputError(f"Worlds: {name}: world {world}, geom {geom}: got {got}, expected {expected}")


def _world_by_world(geoms: NDArray[Any], props: NDArray[Any], worlds: int) -> NDArray[Any]:
    """Interleave (worlds n, ...) with (m, ...), the same in all worlds, to (worlds (n + m), ...)."""
    own = geoms.reshape(worlds, -1, *geoms.shape[1:])
    same = np.broadcast_to(props, (worlds, *props.shape))
    return np.concatenate([own, same], axis=1).reshape(-1, *geoms.shape[1:])
