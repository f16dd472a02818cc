"""A MuJoCo model as something to cast rays against."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from numbers import Real
from types import NoneType
from typing import Literal

import mujoco
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.cast import HitArrays, cast, prepare_cast
from rigcast.kernels.geometry import Shapes
from rigcast.kernels.mounts import BYTES_PER_FRAME, Carriers, Frames
from rigcast.kernels.rays import Rays
from rigcast.kernels.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.kernels.world import World
from rigcast.sensors.errors import InputError, require_type, warn_user
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.surface import Surface
from rigcast.sensors.threads import require_thread_count

from .batch.differences import Differences
from .batch.per_world import PerWorld
from .batch.sources import Batch
from .batch.standing import Standing
from .batch.worlds import Worlds, as_worlds, is_batch
from .flexes import Flexes
from .freed_memory import give_back_freed_memory
from .geoms import Geoms
from .given_rays import GivenRays, take_rays, upload
from .hits import Hits
from .looks import Looks, LooksTable
from .lost import Lost
from .model_geometry import unsupported_parts
from .part import OWNERS, Owner, Part, ShapePoses, Snapshot
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


_MOST_FILTERS = 64  # whose geoms are kept on the device
_NO_DIFFERENCES = Differences()
_BYTES_PER_SIZE = 44  # of a shape, with its tree, its box and its reach


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
        self._geoms, self._props = Geoms(model), Props(model, props, self.device)
        self._parts: list[Part] = [
            self._geoms,
            *([Flexes(model)] if model.nflex else []),
            *([Skins(model)] if model.nskin else []),
            *([self._props] if props else []),
        ]
        self._world = self._make_world()
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
        # views of what the model holds, whoever writes there
        self._looks_now = [values for name in _LOOKS if (values := getattr(model, name)).size]
        self._looks_read: list[bytes] = []
        self._visible: dict[Filter | PerWorld[Filter], wp.array] = {}
        self._looks: Looks | None = None
        self._worlds: int | None = None  # how many there are, if it is a batch of them
        self._differences = _NO_DIFFERENCES
        self._lost_in_worlds = Lost(lambda k: f"{self._geoms.name(k % model.ngeom)} (world {k // model.ngeom})")

    def update(self, data: mujoco.MjData | Batch) -> None:
        """Take the world as it stands in `data` (`geom_xpos`, `geom_xmat`), as `mj_ray` does.

        `data` may be a batch of worlds, whatever `Worlds` takes: they are cast against together.

        After `mj_step` these lag `qpos` by one step; run `mj_kinematics` first to see the world at `data.time`, and
        for flexes (`flexvert_xpos`) `mj_comPos` and `mj_flex` too.
        A geom whose pose is not finite is never hit, and is named in one warning.

        Of the model, sizes of geoms and height fields are seen anew at every update, colours and groups at every
        cast, and meshes when `refresh` says so. Poses of geoms in their bodies need `mj_kinematics` too.

        Raises:
            InputError: `data` belongs to another model, a size or an elevation that is not finite, or a geom that
                has got another type, mesh or height field.
        """
        if is_batch(data):
            self.update_worlds(as_worlds(data))
            return
        self._world.update(*_joined(self._snapshots(data)))
        self._stale, self._worlds = "", None

    def read(self, data: mujoco.MjData) -> ShapePoses:
        """Where everything stands in `data`, for a `sweep`; rays are cast at it after the next `update` or `sweep`."""
        poses = _joined(self._snapshots(data))
        return ShapePoses(poses.position.copy(), poses.rotation.copy())

    def _snapshots(self, data: mujoco.MjData) -> list[Snapshot]:
        """Of all parts as they stand in `data`; their sizes and trees are taken."""
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
        if self._differences is not _NO_DIFFERENCES or any(snapshot.shapes is not None for snapshot in snapshots):
            self._world.set_shapes(self._shapes())
            self._differences, self._visible = _NO_DIFFERENCES, {}
        return snapshots

    def sweep(self, poses: Sequence[ShapePoses]) -> None:
        """Take the world as it moves through these poses, of a `read` each, in as many spans less one.

        Until the next `update`, rays are cast at what stands there at their `span` and `fraction`. Sizes, flexes and
        skins are those of the last `read`.
        """
        self._world.sweep(np.array([each.position for each in poses]), np.array([each.rotation for each in poses]))

    def update_worlds(self, worlds: Worlds) -> Standing:
        """Take many worlds as they stand, and give them on the device.

        Raises:
            InputError: worlds of another model, or a model with flexes or skins, or too little memory.
        """
        worlds.require_model(self.model)
        deforming = [part.owner for part in self._parts if part.owner in ("flex", "skin")]
        if deforming:
            raise InputError(f"Scene: many worlds of a model with a {deforming[0]}, expected a model without one")
        standing = Standing(worlds, self.model, self.device)
        self._take_differences(worlds)
        poses = self._poses(standing)
        if standing.geom_is_finite is not None:
            self._lost_in_worlds.warn(None, standing.geom_is_finite.reshape(-1))
        self._world.update(poses.position, poses.rotation)
        self._stale, self._worlds = "", worlds.count
        return standing

    def _take_differences(self, worlds: Worlds) -> None:
        """Take what has changed in the model, and the sizes and meshes in which worlds differ."""
        differences = worlds.differences
        if differences.dataid is not None and self._geoms.add_assets(differences.dataid):
            self._world, self._differences = self._make_world(), _NO_DIFFERENCES
        renewed = self._geoms.renew()
        for index, tree in (renewed or {}).items():
            self._world.set_tree(index, tree)
        if renewed is None and differences.same_as(self._differences):
            return
        self._world.set_shapes(
            differences.shapes(self._geoms, self._props.shapes, worlds.count)
            if differences.of_shapes
            else self._shapes()
        )
        self._differences, self._visible = differences, {}

    def _poses(self, worlds: Standing) -> Carriers:
        """(nworld, nshape) poses of all shapes: those of the geoms where they are, if there are no props."""
        geoms, props = worlds.geoms, len(self._props.ids)
        if not props:
            return geoms
        frames = Frames.empty(worlds.count, self.model.ngeom + props, self.device)
        frames.copy(geoms)
        self._props.place(frames, self.model.ngeom, worlds)
        return Carriers(frames.position, frames.rotation)

    def bytes_per_world(self, worlds: Worlds) -> int:
        """What each of many worlds takes, beside what is read in it."""
        geoms, props = self.model.ngeom, len(self._props.ids)
        copied = geoms * worlds.bytes_per_pose
        if props:  # the poses of all in one array, and of what carries the props
            copied += (geoms + 2 * props) * BYTES_PER_FRAME
        sizes = (geoms + props) * _BYTES_PER_SIZE if worlds.differences.of_shapes else 0
        return self._world.bytes_per_world + copied + sizes

    def _make_world(self) -> World:
        """A world of all parts, which take over its trees: their triangles are held once."""
        world = World([tree for part in self._parts for tree in part.trees], self._shapes(), self.device)
        trees = iter(world.trees)
        for part in self._parts:
            part.trees = [next(trees) for _ in part.trees]
        give_back_freed_memory()  # what building takes meanwhile is more than the trees
        return world

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
        filter: Filter | Sequence[Filter] | None = None,
        out: Hits | None = None,
    ) -> Hits:
        """The first hit of each ray.

        Args:
            origins: (3,), one for all rays, or like directions [m], in the world.
            directions: (..., 3), of any length but 0, in the world; (nworld, ..., 3) after an update with many worlds.
            max_distance: greatest distance at which something is hit, inclusive [m].
            cull: "back" drops hits on surfaces that face along the ray (d . n > 0), "front" those that face it.
            filter: which geoms may be hit; None: all that are not transparent. Of many worlds it may be a list, one for
                each.
            out: hits of an earlier cast of as many rays on this scene's device, which are written over: no arrays are
                made for the new ones. None makes new arrays.

        Arrays on the host keep float64 and are checked; Warp arrays (vec3 or vec3d, on the scene's device) are
        not: a ray in them that is not finite gives NaN.

        Raises:
            InputError: a shape that does not fit, or a ray that is not finite or has no direction, with its index.
        """
        require_type("Scene.cast: out", out, Hits, NoneType)
        if self._stale:
            raise InputError(f"Scene.cast: {self._stale}, expected scene.update(data) first")
        if not isinstance(cull, str) or cull not in _CULL:
            raise InputError(f"Scene.cast: no cull {cull!r}, {expected_one_of(str(cull), list(_CULL))}")
        wanted = self._wanted(filter)
        require_type("Scene.cast: max_distance", max_distance, Real)
        if not max_distance >= 0:
            raise InputError(f"Scene.cast: max_distance must be at least 0 m, got {max_distance}")
        given = take_rays(origins, directions, self.device)
        room = None if out is None else out.room_for(given.shape, self.device)
        rays, visible = self._placed(given), self.visible(wanted)
        return self.hits(self.cast_rays(rays, visible, max_distance, cull, room), given.shape)

    def _placed(self, given: GivenRays) -> Rays:
        """Rays as they are given, in the world or, by their first axis, in each of many worlds."""
        if self._worlds is None:
            return self.in_pose(Rays(given.directions, given.origins, position=None, rotation=None), np.eye(4))
        worlds = self._worlds
        if given.shape[:1] != (worlds,):
            raise InputError(f"Scene.cast: directions: got shape {(*given.shape, 3)}, expected ({worlds}, ..., 3)")
        each = (worlds, -1)
        return Rays(
            given.directions.reshape(each),
            given.origins if given.origins.size == 1 else given.origins.reshape(each),
            position=wp.zeros(worlds, dtype=wp.vec3d, device=self.device),
            rotation=wp.full(worlds, wp.mat33d(np.eye(3)), dtype=wp.mat33d, device=self.device),
            worlds=worlds,
        )

    def _wanted(self, filter: Filter | Sequence[Filter] | None) -> Filter | PerWorld[Filter]:
        if isinstance(filter, list | tuple) and self._worlds is not None:
            return PerWorld.of("Scene.cast: filter", filter, Filter, self._worlds)
        require_type("Scene.cast: filter", filter, Filter, NoneType)
        return filter if isinstance(filter, Filter) else Filter()

    def visible(self, filter: Filter | PerWorld[Filter]) -> wp.array:
        """(shapes,) or (worlds * shapes,) bool on the device: what a filter lets rays hit, as the model looks now."""
        self._forget_old_looks()
        if filter not in self._visible:
            if len(self._visible) == _MOST_FILTERS:
                self._visible.clear()
            seen = filter.each(self._seen_by) if isinstance(filter, PerWorld) else self._seen_by(filter)
            present = self._differences.present(self._geoms)
            if present is not None:
                seen = np.broadcast_to(seen, (len(present), seen.shape[-1])).copy()
                seen[:, : self.model.ngeom] &= present
            self._visible[filter] = wp.array(seen.reshape(-1), dtype=wp.bool, device=self.device)
        return self._visible[filter]

    def _seen_by(self, filter: Filter) -> NDArray[np.bool_]:
        """(shapes,) what a filter lets rays hit."""
        return np.concatenate([part.visible(filter) for part in self._parts])

    def looks(self) -> Looks:
        """How the shapes look to a sensor's light, as the model looks now."""
        self._forget_old_looks()
        if self._looks is None:
            self._looks = self._looks_table.read(self.device)
        return self._looks

    def _forget_old_looks(self) -> None:
        looks = [values.tobytes() for values in self._looks_now]
        if looks != self._looks_read:
            self._looks_read, self._visible, self._looks = looks, {}, None

    def cast_rays(
        self,
        rays: Rays,
        visible: wp.array,
        max_distance: float,
        cull: Cull = "none",
        out: HitArrays | None = None,
    ) -> HitArrays:
        """The first hit of each ray that is on the device already, among the visible geoms."""
        return cast(self._world.geometry, visible, rays, max_distance, _CULL[cull], out)

    def prepare_cast(
        self, rays: Rays, visible: wp.array, max_distance: float, out: HitArrays
    ) -> list[Callable[[], object]]:
        """The launches of `cast_rays`, for as often as it is wanted, for as long as `visible` gives these geoms."""
        return prepare_cast(self._world.geometry, visible, rays, max_distance, CULL_NONE, out)

    def hits(self, arrays: HitArrays, shape: tuple[int, ...]) -> Hits:
        """The arrays of a cast, for rays of this shape."""
        return Hits(shape, arrays, self.ids_in_use)

    def rays_in_frame(
        self, directions: NDArray[np.float64], origins: NDArray[np.float64], pose: NDArray[np.float64]
    ) -> Rays:
        """Rays on the device: unit directions (..., 3) and origins (..., 3) or (3,) in a frame with this pose."""
        return self.in_pose(
            Rays(upload(directions, self.device), upload(origins, self.device), position=None, rotation=None), pose
        )

    def in_pose(self, rays: Rays, pose: NDArray[np.float64]) -> Rays:
        """The same rays in a frame with another pose (4, 4)."""
        rotation = wp.array(pose[None, :3, :3], dtype=wp.mat33d, device=self.device)
        return replace(rays, position=upload(pose[:3, 3], self.device), rotation=rotation)


def _joined(snapshots: list[Snapshot]) -> ShapePoses:
    """The poses of all; of one they may be those of MuJoCo, not copied."""
    if len(snapshots) == 1:
        return ShapePoses(snapshots[0].position, snapshots[0].rotation)
    return ShapePoses(
        np.concatenate([snapshot.position for snapshot in snapshots]),
        np.concatenate([snapshot.rotation for snapshot in snapshots]),
    )


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
