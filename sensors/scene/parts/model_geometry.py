"""MuJoCo's geoms as shapes and triangle trees.

The functions of SDF geoms cannot run on the device: these geoms are cast by the mesh that MuJoCo keeps for each. It
lies within 0.13 mm of the torus plugin's surface (r 0.35 and 0.15 m); docs/sdf.md has what mj_ray finds instead.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.shapes import solids
from rigcast.kernels.world.arrays import Shapes, TriangleTree, boxes_of
from rigcast.kernels.world.triangle_tree import build_triangle_tree
from rigcast.sensors.errors import InputError, warn_user
from rigcast.sensors.meshes import mesh_of_model
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.scene.cache.trees import FEWEST_FACES, cached_small_trees, cached_triangle_tree

from .height_fields import hfield_data, hfield_tree

_GEOM = mujoco.mjtGeom

_KIND = {
    int(_GEOM.mjGEOM_PLANE): solids.PLANE,
    int(_GEOM.mjGEOM_SPHERE): solids.SPHERE,
    int(_GEOM.mjGEOM_CAPSULE): solids.CAPSULE,
    int(_GEOM.mjGEOM_ELLIPSOID): solids.ELLIPSOID,
    int(_GEOM.mjGEOM_CYLINDER): solids.CYLINDER,
    int(_GEOM.mjGEOM_BOX): solids.BOX,
    int(_GEOM.mjGEOM_MESH): solids.TRIANGLES,
    int(_GEOM.mjGEOM_HFIELD): solids.TRIANGLES,
    int(_GEOM.mjGEOM_SDF): solids.TRIANGLES,
}


@dataclass(frozen=True)
class Asset:
    """A mesh or a height field of a model, by its kind and id."""

    kind: Literal["mesh", "hfield"]
    id: int

    def name(self, model: mujoco.MjModel) -> str:
        """Its name in messages."""
        objects = mujoco.mjtObj.mjOBJ_MESH if self.kind == "mesh" else mujoco.mjtObj.mjOBJ_HFIELD
        return f"{self.kind} {_name(model, objects, self.id)}"

    def tree(
        self, model: mujoco.MjModel, build: Callable[[ArrayLike, ArrayLike], TriangleTree] = build_triangle_tree
    ) -> TriangleTree:
        """The tree of its triangles, in the frame of its geoms. build: makes the tree of a mesh.

        Raises InputError for numbers that are not finite or out of range.
        """
        try:
            if self.kind == "hfield":
                return hfield_tree(model.hfield_size[self.id], hfield_data(model, self.id))
            return build(*mesh_of_model(model, self.id))
        except ValueError as error:
            raise InputError(f"{self.name(model)}: {error}") from None


@dataclass(frozen=True)
class ModelGeometry:
    """Shape k is geom k of the model; tree j that of asset j. `supported`: (ngeom,) False for geoms never hit."""

    assets: list[Asset]
    trees: list[TriangleTree]
    shapes: Shapes
    supported: NDArray[np.bool_]


def read_model(model: mujoco.MjModel) -> ModelGeometry:
    """The geometry of a model: one triangle tree for each mesh and height field in use."""
    assets = assets_in_use(model, model.geom_dataid)
    trees = _trees(model, assets)
    shapes = read_shapes(model, assets, trees, model.geom_size, model.geom_dataid)
    return ModelGeometry(assets, trees, shapes, _is_supported(model))


def _trees(model: mujoco.MjModel, assets: list[Asset]) -> list[TriangleTree]:
    """The tree of each asset; those of meshes are read from disk if they were built before."""
    small = [asset for asset in assets if asset.kind == "mesh" and model.mesh_facenum[asset.id] < FEWEST_FACES]
    meshes = [mesh_of_model(model, asset.id) for asset in small]
    of_small = dict(zip(small, cached_small_trees(meshes, lambda: [a.tree(model) for a in small]), strict=True))
    return [of_small[asset] if asset in of_small else asset.tree(model, cached_triangle_tree) for asset in assets]


def read_shapes(
    model: mujoco.MjModel,
    assets: list[Asset],
    trees: list[TriangleTree],
    size: NDArray[np.float64],
    dataid: NDArray[np.int32],
) -> Shapes:
    """Geoms with these sizes (..., ngeom, 3) and meshes or height fields (..., ngeom), given the tree of each asset.

    With several worlds, geoms are listed world after world.
    """
    kind = np.array([_KIND.get(int(k), solids.SPHERE) for k in model.geom_type], np.int32)
    types, kinds = (np.broadcast_to(each, size.shape[:-1]).reshape(-1) for each in (model.geom_type, kind))
    tree = _trees_of(model, assets, np.broadcast_to(dataid, size.shape[:-1]))
    flat = size.reshape(-1, 3)
    center, half = _local_boxes(types, flat, tree, trees)
    return Shapes(kinds, flat.astype(np.float32), tree, center, half)


def assets_in_use(model: mujoco.MjModel, dataid: NDArray[np.int32]) -> list[Asset]:
    """The meshes and height fields in `dataid` (..., ngeom), sorted by kind and id."""
    present = needs_asset(model) & (dataid >= 0)
    is_hfield = np.broadcast_to(model.geom_type == _GEOM.mjGEOM_HFIELD, dataid.shape)
    hfields, meshes = set(dataid[present & is_hfield].tolist()), set(dataid[present & ~is_hfield].tolist())
    return [Asset("hfield", k) for k in sorted(hfields)] + [Asset("mesh", k) for k in sorted(meshes)]


def needs_asset(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms (ngeom,) consist of triangles: of a mesh or a height field."""
    triangles = [kind for kind, solid in _KIND.items() if solid == solids.TRIANGLES]
    return np.isin(model.geom_type, triangles) & _is_supported(model)


def _trees_of(model: mujoco.MjModel, assets: list[Asset], dataid: NDArray[np.int32]) -> NDArray[np.int32]:
    """The tree (n,) of each geom of each world, -1 for none."""
    of_asset = {"mesh": np.full(model.nmesh + 1, -1, np.int32), "hfield": np.full(model.nhfield + 1, -1, np.int32)}
    for tree, asset in enumerate(assets):
        of_asset[asset.kind][asset.id] = tree
    is_hfield = model.geom_type == _GEOM.mjGEOM_HFIELD
    mesh = np.where(needs_asset(model) & ~is_hfield, dataid, -1)
    hfield = np.where(is_hfield, dataid, -1)
    return np.maximum(of_asset["mesh"][mesh], of_asset["hfield"][hfield]).reshape(-1)


def _is_supported(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms (ngeom,) rays can hit; SDF geoms are hit by their mesh, if they have one."""
    has_mesh = (model.geom_type != _GEOM.mjGEOM_SDF) | (model.geom_dataid >= 0)
    return np.asarray(np.isin(model.geom_type, list(_KIND)) & has_mesh)


def unsupported_parts(model: mujoco.MjModel) -> list[str]:
    """The parts of the model that rays cannot hit, by kind and name."""
    is_supported = _is_supported(model)
    return [
        f"{_GEOM(int(kind)).name.removeprefix('mjGEOM_').lower()} geom {_name(model, mujoco.mjtObj.mjOBJ_GEOM, g)}"
        for g, kind in enumerate(model.geom_type)
        if not is_supported[g]
    ]


def refuse_unsupported(model: mujoco.MjModel, on_unsupported: str) -> None:
    """Raise InputError, or warn for "warn", if the model has parts that rays cannot hit."""
    if on_unsupported not in ("error", "warn"):
        raise InputError(
            f"Scene: no on_unsupported {on_unsupported!r}, {expected_one_of(str(on_unsupported), ['error', 'warn'])}"
        )
    parts = unsupported_parts(model)
    if not parts:
        return
    message = f"rays cannot hit {', '.join(parts)}"
    if on_unsupported == "warn":
        warn_user(f"{message}; left out", UserWarning)
    else:
        raise InputError(f'Scene: {message}; remove them, or leave them out with on_unsupported="warn"')


def _name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    name = mujoco.mj_id2name(model, kind, index)
    return f"'{name}'" if name else f"{index} (unnamed)"


def _local_boxes(
    types: NDArray[np.int32], size: NDArray[np.float64], tree: NDArray[np.int32], trees: list[TriangleTree]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Centre and half size (n, 3) [m] of each geom's box in its own frame; half size +inf if it is unbounded."""
    zero = np.zeros(len(size))
    by_type = {
        _GEOM.mjGEOM_PLANE: np.stack([*np.where(size[:, :2] > 0, size[:, :2], np.inf).T, zero], axis=-1),
        _GEOM.mjGEOM_SPHERE: size[:, [0, 0, 0]],
        _GEOM.mjGEOM_CAPSULE: np.stack([size[:, 0], size[:, 0], size[:, 0] + size[:, 1]], axis=-1),
        _GEOM.mjGEOM_ELLIPSOID: size,
        _GEOM.mjGEOM_CYLINDER: size[:, [0, 0, 1]],
        _GEOM.mjGEOM_BOX: size,
    }
    extents = np.zeros((len(size), 3))
    for kind, extent in by_type.items():
        extents = np.where((types == kind)[:, None], extent, extents)
    # float64 to float32 may round a half size down
    center, half = np.zeros((len(size), 3), np.float32), (extents * (1 + 1e-6)).astype(np.float32)
    has_tree = tree >= 0
    center[has_tree], half[has_tree] = (ends[tree[has_tree]] for ends in boxes_of(trees))
    return center, half
