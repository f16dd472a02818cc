"""A MuJoCo model as something to cast rays against."""

from collections.abc import Sequence
from dataclasses import replace
from numbers import Real
from types import NoneType
from typing import Literal

import mujoco
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.cast import HitArrays, as_double, cast, unit_directions
from rigcast.kernels.geometry import FARTHEST, Shapes
from rigcast.kernels.rays import Rays
from rigcast.kernels.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.kernels.world import World
from rigcast.sensors.errors import InputError, require_type, warn_user
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.surface import Surface
from rigcast.sensors.threads import require_thread_count

from .flexes import Flexes
from .geoms import Geoms
from .hits import Hits
from .looks import Looks, LooksTable
from .model_geometry import unsupported_parts
from .part import OWNERS, Owner, Part, ShapePoses
from .props import Props
from .skins import Skins

Cull = Literal["none", "back", "front"]

_CULL: dict[str, int] = {"none": CULL_NONE, "back": CULL_BACK, "front": CULL_FRONT}

# What filters and surfaces ask of a model, besides the tree of its bodies.
_LOOKS = (
    *("geom_rgba", "geom_matid", "geom_group", "geom_contype", "geom_conaffinity", "mat_rgba"),
    *("flex_rgba", "flex_matid", "flex_group", "flex_contype", "flex_conaffinity"),
    *("skin_rgba", "skin_matid", "skin_group"),
    *("mat_reflectance", "mat_texid"),
)


class Scene:
    """The geoms of a MuJoCo model, ready for rays.

    Args:
        model: the model. Its meshes are read now, all the rest at every `update`.
        device: a Warp device; None takes CUDA if it is present, else "cpu".
        props: meshes that are not in the model, with different names.
        surfaces: how some of it reflects, in place of the model's colours; for sensors that measure intensity.
        on_unsupported: what to do about geometry that rays cannot hit (SDF geoms without a mesh): "error"
            raises InputError, "warn" warns and leaves it out.

    >>> scene = rigcast.Scene(model)
    >>> scene.update(data)
    >>> scene.cast((0, 0, 1), (1, 0, 0)).numpy().distance
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        device: wp.DeviceLike = None,
        props: Sequence[Prop] = (),
        *,
        surfaces: Sequence[Surface] = (),
        on_unsupported: Literal["error", "warn"] = "error",
    ) -> None:
        require_type("Scene: model", model, mujoco.MjModel)
        _report(unsupported_parts(model), on_unsupported)
        self.model = model
        require_thread_count()
        self.device = _find_device(device)
        self._geoms = Geoms(model)
        self._parts: list[Part] = [
            self._geoms,
            *([Flexes(model)] if model.nflex else []),
            *([Skins(model)] if model.nskin else []),
            Props(model, props),
        ]
        self._world = World([tree for part in self._parts for tree in part.trees], self._shapes(), self.device)
        for part in self._parts:
            part.trees = [tree.outline() for tree in part.trees]
        owners = np.concatenate([np.full(len(part.ids), part.owner) for part in self._parts])
        ids = np.concatenate([part.ids for part in self._parts])
        in_use = {"geom"} | {part.owner for part in self._parts if len(part.ids)}
        self.ids_in_use: dict[Owner, wp.array] = {
            owner: wp.array(np.where(owners == owner, ids, -1), dtype=int, device=self.device)
            for owner in OWNERS
            if owner in in_use
        }
        bodies = np.concatenate([part.bodies for part in self._parts])
        self._looks_table = LooksTable(model, (owners, ids, bodies), [prop.name for prop in props], surfaces)
        self.body_of_shape = wp.array(bodies, dtype=int, device=self.device)
        self._stale = "no poses yet"
        self._looks_read: list[bytes] = []
        self._visible: dict[Filter, wp.array] = {}
        self._looks: Looks | None = None

    def update(self, data: mujoco.MjData) -> None:
        """Take the world as it stands in `data` (`geom_xpos`, `geom_xmat`), as `mj_ray` does.

        After `mj_step` these lag `qpos` by one step; run `mj_kinematics` first to see the world at `data.time`, and
        for flexes (`flexvert_xpos`) `mj_comPos` and `mj_flex` too.
        A geom whose pose is not finite is never hit, and is named in one warning.

        Of the model, sizes of geoms and height fields are seen anew at every update, colours and groups at every
        cast, and meshes when `refresh` says so. Poses of geoms in their bodies need `mj_kinematics` too.

        Raises:
            InputError: `data` belongs to another model, a size or an elevation that is not finite, or a geom that
                has got another type, mesh or height field.
        """
        self._world.update(*self.read(data))
        self._stale = ""

    def read(self, data: mujoco.MjData) -> ShapePoses:
        """Where everything stands in `data`, for a `sweep`; rays are cast at it after the next `update` or `sweep`."""
        require_type("Scene.update: data", data, mujoco.MjData)
        if data.signature != self.model.signature:
            raise InputError(
                f"Scene.update: data belongs to another model: got signature {data.signature:#x} with "
                f"{len(data.geom_xpos)} geoms, expected {self.model.signature:#x} with {self.model.ngeom}"
            )
        snapshots = [part.update(data) for part in self._parts]
        first_tree = 0
        for part, snapshot in zip(self._parts, snapshots, strict=True):
            for index, tree in snapshot.trees.items():
                self._world.set_tree(first_tree + index, tree)
            if snapshot.shapes is not None:
                part.shapes = snapshot.shapes
            first_tree += len(part.trees)
        if any(snapshot.shapes is not None for snapshot in snapshots):
            self._world.set_shapes(self._shapes())
        return ShapePoses(
            np.concatenate([snapshot.position for snapshot in snapshots]),
            np.concatenate([snapshot.rotation for snapshot in snapshots]),
        )

    def sweep(self, poses: Sequence[ShapePoses]) -> None:
        """Take the world as it moves through these poses, of a `read` each, in as many spans less one.

        Until the next `update`, rays are cast at what stands there at their `span` and `fraction`. Sizes, flexes and
        skins are those of the last `read`.
        """
        self._world.sweep(np.array([each.position for each in poses]), np.array([each.rotation for each in poses]))

    def refresh(self, name: str) -> None:
        """Say that a mesh (`mesh_vert`, `mesh_face`) or height field of this name has been edited in the model.

        The next `update` reads it anew; casting is refused until then. Height fields, which every update compares
        with what they were, need no `refresh`.

        Raises:
            InputError: the model has neither a mesh nor a height field of this name.
        """
        self._geoms.refresh(name)
        self._stale = f"{name!r} has been edited"

    def _shapes(self) -> Shapes:
        """The shapes of all parts, one after the other."""
        first_tree = np.cumsum([0, *(len(part.trees) for part in self._parts)])[:-1]
        return Shapes.joined([part.shapes for part in self._parts], first_tree)

    def cast(
        self,
        origins: ArrayLike | wp.array,
        directions: ArrayLike | wp.array,
        max_distance: float = np.inf,
        cull: Cull = "none",
        filter: Filter | None = None,
    ) -> Hits:
        """The first hit of each ray.

        Args:
            origins: (3,), one for all rays, or like directions [m], in the world.
            directions: (..., 3), of any length but 0, in the world.
            max_distance: greatest distance at which something is hit, inclusive [m].
            cull: "back" drops hits on surfaces that face along the ray (d . n > 0), "front" those that face it.
            filter: which geoms may be hit; None: all that are not transparent.

        Arrays on the host keep float64 and are checked; Warp arrays (vec3 or vec3d, on the scene's device) are
        not: a ray in them that is not finite gives NaN.

        Raises:
            InputError: a shape that does not fit, or a ray that is not finite or has no direction, with its index.
        """
        if self._stale:
            raise InputError(f"Scene.cast: {self._stale}, expected scene.update(data) first")
        if not isinstance(cull, str) or cull not in _CULL:
            raise InputError(f"Scene.cast: no cull {cull!r}, {expected_one_of(str(cull), list(_CULL))}")
        require_type("Scene.cast: filter", filter, Filter, NoneType)
        require_type("Scene.cast: max_distance", max_distance, Real)
        if not max_distance >= 0:
            raise InputError(f"Scene.cast: max_distance must be at least 0 m, got {max_distance}")
        if isinstance(directions, wp.array):
            shape = tuple(directions.shape)
            rays = self._device_rays(origins, directions)
        else:
            host_origins, host_directions = _checked_rays(origins, directions)
            shape = host_directions.shape[:-1]
            rays = self.rays_in_frame(host_directions, host_origins, np.eye(4))
        return self.hits(self.cast_rays(rays, self.visible(filter), max_distance, cull), shape)

    def visible(self, filter: Filter | None) -> wp.array:
        """(shapes,) bool on the device: which shapes a filter lets rays hit, as the model looks now."""
        self._forget_old_looks()
        wanted = filter or Filter()
        if wanted not in self._visible:
            seen = np.concatenate([part.visible(wanted) for part in self._parts])
            self._visible[wanted] = wp.array(seen, dtype=wp.bool, device=self.device)
        return self._visible[wanted]

    def looks(self) -> Looks:
        """How the shapes look to a sensor's light, as the model looks now."""
        self._forget_old_looks()
        if self._looks is None:
            self._looks = self._looks_table.read(self.device)
        return self._looks

    def _forget_old_looks(self) -> None:
        looks = [getattr(self.model, name).tobytes() for name in _LOOKS]
        if looks != self._looks_read:
            self._looks_read, self._visible, self._looks = looks, {}, None

    def cast_rays(self, rays: Rays, visible: wp.array, max_distance: float, cull: Cull = "none") -> HitArrays:
        """The first hit of each ray that is on the device already, among the visible geoms."""
        return cast(self._world.geometry, visible, rays, max_distance, _CULL[cull])

    def hits(self, arrays: HitArrays, shape: tuple[int, ...]) -> Hits:
        """The arrays of a cast, for rays of this shape."""
        return Hits(shape, arrays, self.ids_in_use)

    def rays_in_frame(
        self, directions: NDArray[np.float64], origins: NDArray[np.float64], pose: NDArray[np.float64]
    ) -> Rays:
        """Rays on the device: unit directions (..., 3) and origins (..., 3) or (3,) in a frame with this pose."""
        return self.in_pose(Rays(self._upload(directions), self._upload(origins), position=None, rotation=None), pose)

    def in_pose(self, rays: Rays, pose: NDArray[np.float64]) -> Rays:
        """The same rays in a frame with another pose (4, 4)."""
        rotation = wp.array(pose[None, :3, :3], dtype=wp.mat33d, device=self.device)
        return replace(rays, position=self._upload(pose[:3, 3]), rotation=rotation)

    def _upload(self, vectors: NDArray[np.float64]) -> wp.array:
        return wp.array(np.ascontiguousarray(vectors).reshape(-1, 3), dtype=wp.vec3d, device=self.device)

    def _device_rays(self, origins: ArrayLike | wp.array, directions: wp.array) -> Rays:
        if not isinstance(origins, wp.array):
            origins = self._upload(_checked_origins(origins))
        for name, array in (("origins", origins), ("directions", directions)):
            self._require_vectors(name, array)
        if origins.size not in (1, directions.size):
            raise InputError(f"Scene.cast: origins: got {origins.size}, expected 1 or {directions.size}")
        rays = Rays(unit_directions(directions.flatten()), as_double(origins.flatten()), position=None, rotation=None)
        return self.in_pose(rays, np.eye(4))

    def _require_vectors(self, name: str, array: wp.array) -> None:
        if array.dtype not in (wp.vec3, wp.vec3d):
            raise InputError(f"Scene.cast: {name}: got an array of {array.dtype.__name__}, expected vec3 or vec3d")
        if array.device != self.device:
            raise InputError(f"Scene.cast: {name}: got an array on {array.device}, expected {self.device}")


def _find_device(device: wp.DeviceLike) -> wp.Device:
    wp.init()
    if device is None:
        return wp.get_preferred_device()
    try:
        return wp.get_device(device)
    except (ValueError, RuntimeError):
        names = [found.alias for found in wp.get_devices()]
        raise InputError(f"no device {str(device)!r}, {expected_one_of(str(device), names)}") from None


def _report(parts: list[str], on_unsupported: str) -> None:
    if on_unsupported not in ("error", "warn"):
        raise InputError(
            f"Scene: no on_unsupported {on_unsupported!r}, {expected_one_of(str(on_unsupported), ['error', 'warn'])}"
        )
    if not parts:
        return
    message = f"rays cannot hit {', '.join(parts)}"
    if on_unsupported == "warn":
        warn_user(f"{message}; left out", UserWarning)
    else:
        raise InputError(f'Scene: {message}; remove them, or leave them out with on_unsupported="warn"')


def _checked_rays(origins: ArrayLike, directions: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origins and unit directions, float64."""
    d, o = _vectors("directions", directions), _checked_origins(origins)
    if o.shape not in ((3,), d.shape):
        raise InputError(f"Scene.cast: origins: got shape {o.shape}, expected (3,) or {d.shape}")
    # scaled by the largest component first: squares of 1e-200 would vanish
    largest = np.abs(d).max(axis=-1, keepdims=True, initial=0.0)
    _refuse_rays("directions", d, ~np.isfinite(d).all(axis=-1), "finite numbers")
    _refuse_rays("directions", d, largest[..., 0] == 0.0, "a direction of any length but 0")
    scaled = d / largest
    return o, scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)


def _checked_origins(origins: ArrayLike) -> NDArray[np.float64]:
    o = _vectors("origins", origins)
    _refuse_rays("origins", o, ~(np.abs(o) <= FARTHEST).all(axis=-1), f"finite numbers up to {FARTHEST:g} m")
    return o


def _refuse_rays(name: str, values: NDArray[np.float64], bad: NDArray[np.bool_] | np.bool_, expected: str) -> None:
    """Raise InputError for the first of the rays that are bad."""
    if bad.any():
        ray = tuple(int(i) for i in np.argwhere(bad)[0])
        index = ray[0] if len(ray) == 1 else ray
        where = f"ray {index}: " if ray else ""
        raise InputError(f"Scene.cast: {where}{name}: got {values[ray].tolist()}, expected {expected}")


def _vectors(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"Scene.cast: {name}: expected an array of numbers (..., 3): {error}") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"Scene.cast: {name}: expected an array of numbers (..., 3), got {array.dtype} {values!r:.80}")
    if array.ndim == 0 or array.shape[-1] != 3:
        raise InputError(f"Scene.cast: {name}: got shape {array.shape}, expected (..., 3)")
    return array.astype(np.float64, copy=False)
