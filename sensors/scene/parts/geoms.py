"""The geoms of a model as a part of a scene."""

from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.host.poses import TakenPoses
from rigcast.kernels.host.watching import Watched
from rigcast.kernels.world.arrays import Shapes, TriangleTree
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.names import expected_one_of, model_names
from rigcast.sensors.specs.filter import Filter

from .height_fields import hfield_data
from .lost import Lost
from .model_geometry import assets_in_use, needs_asset, read_model, read_shapes
from .part import Owner, Snapshot


def geom_name(model: mujoco.MjModel, geom: int) -> str:
    """The name of a geom in messages."""
    return model.geom(geom).name or f"geom {geom}"


class Geoms:
    """Shape k is geom k; poses are taken as they stand in the data, as `mj_ray` does.

    Sizes and height fields are compared at every update with what they were. Meshes are not: they seldom change,
    and comparing would cost more than casting. `refresh` says that one has.
    """

    owner: Owner = "geom"

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._require_finite_sizes()
        geometry = read_model(model)
        self.trees = geometry.trees
        self.shapes = geometry.shapes
        self.ids = np.arange(model.ngeom, dtype=np.int32)
        self.bodies = model.geom_bodyid.astype(np.int32)
        self._supported = geometry.supported
        self.poses = TakenPoses(model.ngeom)
        self._unchanged = Snapshot(self.poses.position.numpy(), self.poses.rotation.numpy().reshape(-1, 9))
        self._lost = Lost(partial(geom_name, model))
        self._assets = geometry.assets
        # views of the model's memory, which show edits
        self._kinds_now = [model.geom_type.data, model.geom_dataid.data]
        self._now = [*self._kinds_now, model.geom_size.data]
        self._kinds, self._read = b"".join(self._kinds_now), b"".join(self._now)
        self._hfields = self._watched_hfields()
        self._to_refresh: set[int] = set()

    def update(self, data: mujoco.MjData) -> Snapshot:
        """Raises InputError for a size or height field that has become unusable, and for a geom of another kind."""
        trees = self.renew()
        if self.poses.take(data.geom_xpos, data.geom_xmat) or self._lost.any:
            self._lost.warn(data.time, np.asarray(np.isfinite(self._unchanged.position).all(axis=1)))
        return self._unchanged if trees is None else self._unchanged._replace(shapes=self.shapes, trees=trees)

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        return filter.visible(self.model) & self._supported

    def refresh(self, name: str) -> None:
        """See `Scene.refresh`."""
        require_type("Scene.refresh: name", name, str)  # MuJoCo would dereference None
        ids = {
            "mesh": mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_MESH, name),
            "hfield": mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_HFIELD, name),
        }
        if max(ids.values()) < 0:
            names = model_names(self.model, mujoco.mjtObj.mjOBJ_MESH, self.model.nmesh)
            names += model_names(self.model, mujoco.mjtObj.mjOBJ_HFIELD, self.model.nhfield)
            raise InputError(f"Scene.refresh: no mesh or height field {name!r}, {expected_one_of(name, names)}")
        self._to_refresh |= {k for k, asset in enumerate(self._assets) if ids[asset.kind] == asset.id}

    def renew(self) -> dict[int, TriangleTree] | None:
        """Reread what has changed in the model; return the changed trees, or None if nothing has changed.

        Raises InputError for a size or height field that has become unusable, and for a geom of another kind.
        """
        now, stale = b"".join(self._now), self._stale()
        if now == self._read and not stale:
            return None
        if b"".join(self._kinds_now) != self._kinds:
            raise InputError("Scene.update: geom_type or geom_dataid has changed; make a new Scene of the model")
        self._require_finite_sizes()
        renewed = {k: self._assets[k].tree(self.model) for k in sorted(stale)}
        self.trees = [renewed.get(k, tree) for k, tree in enumerate(self.trees)]
        self.shapes = self.shapes_with(self.model.geom_size, self.model.geom_dataid)
        self._read, self._to_refresh = now, set()
        for k in stale & self._hfields.keys():
            self._hfields[k].taken()
        return renewed

    def have_changed(self) -> bool:
        """Whether there is anything to `renew`."""
        return b"".join(self._now) != self._read or bool(self._stale())

    def _stale(self) -> set[int]:
        """The indices of trees whose meshes or height fields have changed."""
        if not self._hfields:
            return self._to_refresh
        return self._to_refresh | {k for k, hfield in self._hfields.items() if hfield.have_changed()}

    def shapes_with(self, size: NDArray[np.float64], dataid: NDArray[np.int32]) -> Shapes:
        """The geoms with these sizes (..., ngeom, 3) and meshes (..., ngeom), world after world."""
        return read_shapes(self.model, self._assets, self.trees, size, dataid)

    def _require_finite_sizes(self) -> None:
        bad = np.flatnonzero(~(np.abs(self.model.geom_size) <= FARTHEST).all(axis=1))
        if bad.size:
            geom = self.model.geom(bad[0])
            name = geom.name or f"{bad[0]} (unnamed)"
            raise InputError(
                f"geom {name}: size: got {geom.size.tolist()}, expected finite numbers up to {FARTHEST:g} m"
            )

    def add_assets(self, dataid: NDArray[np.int32]) -> bool:
        """Build the missing trees of assets in `dataid` (..., ngeom); return whether any were missing."""
        added = [asset for asset in assets_in_use(self.model, dataid) if asset not in self._assets]
        self.trees = self.trees + [asset.tree(self.model) for asset in added]  # which may raise
        self._assets = self._assets + added
        # those watched before may have edits that no update has seen
        self._hfields = self._watched_hfields() | self._hfields
        return bool(added)

    def is_present(self, dataid: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Which geoms (..., ngeom) are present: all but those with a mesh or height field in the model and -1 here."""
        return ~(needs_asset(self.model) & (dataid < 0))

    def _watched_hfields(self) -> dict[int, Watched]:
        """The arrays that trees of height fields follow from, watched for changes, by index of the tree."""
        hfields = {k: asset.id for k, asset in enumerate(self._assets) if asset.kind == "hfield"}
        return {k: Watched([self.model.hfield_size[id], hfield_data(self.model, id)]) for k, id in hfields.items()}


def are_within_reach(values: NDArray[np.floating]) -> bool:
    """Whether no value is NaN or beyond FARTHEST."""
    return bool(values.min(initial=0) >= -FARTHEST and values.max(initial=0) <= FARTHEST)


def has_finite_pose(position: NDArray[np.floating], rotation: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Which poses (n,) are finite, of positions (n, 3) and rotations (n, 9)."""
    return np.asarray((np.abs(position) <= FARTHEST).all(axis=1) & np.isfinite(rotation).all(axis=1))
