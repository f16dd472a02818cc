"""A MuJoCo model on a device, for casts of sensors' rays."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import Readings, cast, prepare_hits, prepare_readings
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.host.gather import Gathered
from rigcast.kernels.poses.mounts import BYTES_PER_FRAME
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.triangle import CULL_NONE
from rigcast.kernels.single.reused import ReusedCasts
from rigcast.kernels.world.world import World
from rigcast.sensors.captured import is_captured, require_as_before, require_on_device
from rigcast.sensors.errors import InputError
from rigcast.sensors.fixed import fixed
from rigcast.sensors.in_use import InUse
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.surface import Surface

from .batch.differences import Differences
from .batch.per_world import PerWorld
from .batch.posed_worlds import PosedWorlds
from .batch.world_mounts import WorldMounts
from .batch.worlds import Worlds
from .freed_memory import give_back_freed_memory
from .hits import Hits
from .looks import Looks, LooksTable
from .parts.flexes import Flexes
from .parts.geoms import Geoms, are_within_reach, geom_name, has_finite_pose
from .parts.lost import Lost
from .parts.part import Part, ShapePoses, Snapshot, joined_poses, joined_shapes, owners_and_ids
from .parts.props import Props
from .parts.skins import Skins
from .shape_ids import ShapeIds
from .sight import Sight

_NO_DIFFERENCES = Differences()
_UNDER_WAY = "the last update failed"  # set during an update; a failed one may have taken some poses
_BYTES_PER_SIZE = 48  # of a shape: size, tree, box and reach


class Stage:
    """The geoms, flexes, skins and props of a model on a device, at the poses last taken.

    Sensors cast their rays at it, with arguments of its model and on its device, which are not checked. `Scene` is a
    stage for users, and checks their arguments.

    shape_ids: the objects to which shapes belong. body_of_shape: (shapes,) int32, the body of each shape, -1 if it
    belongs to several bodies or none.
    """

    def __init__(
        self, model: mujoco.MjModel, device: wp.Device, props: Sequence[Prop], surfaces: Sequence[Surface]
    ) -> None:
        self._model, self._device = model, device
        self._in_use = InUse()
        self._geoms, self._props = Geoms(model), Props(model, props)
        self._parts: list[Part] = [
            self._geoms,
            *([Flexes(model)] if model.nflex else []),
            *([Skins(model)] if model.nskin else []),
            *([self._props] if props else []),
        ]
        # where poses of geoms are taken to, to be used there if there is nothing else
        self._in_place = self._geoms.poses if self._device.is_cpu and self._parts == [self._geoms] else None
        self._world = self._make_world()
        self._single_casts = ReusedCasts(self._world.geometry)
        owners, ids = owners_and_ids(self._parts)
        self._shape_ids = ShapeIds.of(owners, ids, self._device)
        bodies = np.concatenate([part.bodies for part in self._parts])
        table = LooksTable(model, (owners, ids, bodies), [prop.name for prop in props], surfaces)
        self._sight = Sight(model, self._parts, table, self._device)
        self._body_of_shape = wp.array(bodies, dtype=int, device=self._device)
        self._stale = "no poses yet"  # the reason why nothing can be cast, if so
        self._is_whole = True  # whether the world is not half changed
        self._worlds: int | None = None  # their number, after an update with many worlds
        self._room: object = None
        self._prop_mounts = [WorldMounts.by([mount], device) for mount in self._props.mounts]  # in many worlds
        # where poses of many worlds are copied together, and to the device
        self._gathered: dict[str, Gathered] = {}
        self._uploads: dict[object, wp.array] = {}
        self._part: slice | None = None  # which of the worlds stand, if not all
        self._differences = _NO_DIFFERENCES
        self._lost_in_worlds = Lost(lambda k: f"{geom_name(model, k % model.ngeom)} (world {k // model.ngeom})")

    @fixed
    def model(self) -> mujoco.MjModel:
        return self._model

    @fixed
    def device(self) -> wp.Device:
        return self._device

    @fixed
    def room(self) -> object:
        """Memory needs of the last reading of many worlds."""
        return self._room

    def had_room(self, needs: object) -> None:
        """Say that a reading of many worlds with these memory needs has been made."""
        self._room = needs

    @fixed
    def in_use(self) -> InUse:
        return self._in_use

    @fixed
    def shape_ids(self) -> ShapeIds:
        return self._shape_ids

    @fixed
    def body_of_shape(self) -> wp.array:
        return self._body_of_shape

    def _make_world(self) -> World:
        """A World of all parts. The parts take over its trees, so that triangles are stored once."""
        world = World([tree for part in self._parts for tree in part.trees], joined_shapes(self._parts), self._device)
        trees = iter(world.trees)
        for part in self._parts:
            part.trees = [next(trees) for _ in part.trees]
        give_back_freed_memory()  # what building takes meanwhile is more than the trees
        return world

    def _begin_change(self) -> None:
        """Begin a change of the world; after one that failed (out of memory, Ctrl-C) the world is rebuilt first."""
        if not self._is_whole:
            self._world, self._differences = self._make_world(), _NO_DIFFERENCES
            self._sight.forget_visible()
        self._is_whole = False

    def take(self, data: mujoco.MjData) -> None:
        """Take everything as it stands in `data`: what `Scene.update` does with one world."""
        self._stale = _UNDER_WAY
        self._begin_change()
        snapshots = self._snapshots(data)
        if self._in_place is None:
            self._world.update(*joined_poses(snapshots))
        else:
            self._world.update(self._in_place.position, self._in_place.rotation)
        self._stale, self._worlds, self._part, self._is_whole = "", None, None, True

    def read(self, data: mujoco.MjData) -> ShapePoses:
        """The poses of all shapes in `data`, for a `sweep`.

        Casts still see the previous poses until the next `update` or `sweep`.
        """
        taken = [array.numpy() for array in (self._geoms.poses.position, self._geoms.poses.rotation)]
        in_place = [values.copy() for values in taken]  # casts may read `taken` in place until the next update
        self._begin_change()
        try:
            poses = joined_poses(self._snapshots(data))
            self._is_whole = True
            return ShapePoses(poses.position.copy(), poses.rotation.copy())
        finally:
            for values, before in zip(taken, in_place, strict=True):
                values[...] = before

    def _snapshots(self, data: mujoco.MjData) -> list[Snapshot]:
        """Snapshots of all parts in `data`; takes over their sizes and trees."""
        if self._device.is_cuda:
            require_on_device("Scene.update: data", "MjData", self._device)
        self._sight.update()
        snapshots, is_as_it_was = [], self._differences is _NO_DIFFERENCES
        for part in self._parts:
            snapshot = part.update(data)
            snapshots.append(snapshot)
            is_as_it_was = is_as_it_was and snapshot.shapes is None
        if not is_as_it_was:
            self._take_shapes(snapshots)
        return snapshots

    def _take_shapes(self, snapshots: Sequence[Snapshot]) -> None:
        first_tree = 0
        for part, snapshot in zip(self._parts, snapshots, strict=True):
            for index, tree in snapshot.trees.items():
                self._world.set_tree(first_tree + index, tree)
            if snapshot.shapes is not None:
                part.shapes = snapshot.shapes
            first_tree += len(part.trees)
        self._world.set_shapes(joined_shapes(self._parts))
        self._differences = _NO_DIFFERENCES
        self._sight.forget_visible()

    def sweep(self, poses: Sequence[ShapePoses]) -> None:
        """Take the world as it moves through these poses, of a `read` each, in as many spans less one.

        Until the next `update`, rays are cast at what stands there at their `span` and `fraction`. Sizes, flexes and
        skins are those of the last `read`.
        """
        self._begin_change()
        self._world.sweep(np.array([each.position for each in poses]), np.array([each.rotation for each in poses]))
        self._is_whole = True

    def take_worlds(self, worlds: Worlds) -> None:
        """Take what many worlds specify besides poses, and changes of the model.

        Raises:
            InputError: worlds of another model, or a model with flexes or skins.
        """
        worlds.require_model(self._model)
        self._stale = _UNDER_WAY
        self._sight.update()
        deforming = [part.owner for part in self._parts if part.owner in ("flex", "skin")]
        if deforming:
            raise InputError(f"Scene: many worlds of a model with a {deforming[0]}, expected a model without one")
        self._begin_change()
        self._take_differences(worlds)
        self._is_whole = True

    def _take_differences(self, worlds: Worlds) -> None:
        """Take changes of the model, and the sizes and meshes in which worlds differ."""
        differences = worlds.differences
        if is_captured(self._device) and (self._geoms.have_changed() or not differences.same_as(self._differences)):
            require_as_before("Scene: sizes, meshes or what is visible are others", self._device)
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
            else joined_shapes(self._parts)
        )
        self._differences = differences
        self._sight.forget_visible()

    def pose_worlds(self, worlds: Worlds, part: slice) -> PosedWorlds:
        """Take the current poses of some of the worlds last taken, or of all. `cast` needs all."""
        posed = PosedWorlds(worlds, part, self._model, self._device, self._gathered, self._uploads)
        position, rotation = posed.geoms
        if isinstance(position, np.ndarray):
            self._warn_of_lost(position, rotation, part.start)
        self._part = None if part == worlds.all else part
        position, rotation = posed.shapes(self._prop_mounts)
        self._begin_change()
        self._world.update(position, rotation, self._part)
        self._is_whole = True
        self._stale = "" if self._part is None else "only some of many worlds stand in it"
        self._worlds = worlds.count
        return posed

    def _warn_of_lost(
        self, position: NDArray[np.floating[Any]], rotation: NDArray[np.floating[Any]], first: int
    ) -> None:
        """Warn of geoms whose poses are not finite, in worlds `first`, first + 1, ..."""
        if self._lost_in_worlds.any or not (are_within_reach(position) and are_within_reach(rotation)):
            is_finite = has_finite_pose(position.reshape(-1, 3), rotation.reshape(-1, 9))
            self._lost_in_worlds.warn(None, is_finite, first * self._model.ngeom)

    def bytes_per_world(self, worlds: Worlds) -> int:
        """Bytes per world for sizes and meshes of its own, besides its readings."""
        return self._body_of_shape.size * _BYTES_PER_SIZE if worlds.differences.of_shapes else 0

    def bytes_per_posed_world(self, worlds: Worlds) -> int:
        """Bytes per world that is posed at one time: its poses, and the tree over its shapes."""
        geoms, props = self._model.ngeom, len(self._props.ids)
        copied = geoms * worlds.bytes_per_pose
        if props:  # the poses of all in one array, and of what carries the props
            copied += (geoms + 2 * props) * BYTES_PER_FRAME
        return self._world.bytes_per_world + copied

    @property
    def on_device(self) -> list[object]:
        """Owners of its arrays on the device; a CUDA graph that repeats its launches must hold these."""
        return [*self._world.on_device, *self._sight.on_device]

    def visible(self, filter: Filter | PerWorld[Filter]) -> wp.array:
        """Which shapes a filter lets rays hit, (shapes,) or (worlds * shapes,) bool on the device.

        With many worlds, for those that are posed now.
        """
        visible = self._sight.visible(filter, lambda: self._differences.present(self._geoms))
        shapes = self._body_of_shape.size
        if self._part is None or visible.size == shapes:
            return visible
        return visible[self._part.start * shapes : self._part.stop * shapes]

    def looks(self) -> Looks:
        """How the shapes look to a sensor's light."""
        return self._sight.looks()

    def cast_rays(
        self,
        rays: Rays,
        visible: wp.array,
        max_distance: float,
        cull: int = CULL_NONE,
        out: HitArrays | None = None,
    ) -> HitArrays:
        """The first hit of each ray among the visible geoms.

        cull: CULL_NONE, CULL_BACK or CULL_FRONT of rigcast.kernels.shapes.triangle.
        """
        geometry = self._world.geometry
        if rays.packets is not None or not self._device.is_cpu or geometry.instants > 1:
            return cast(geometry, visible, rays, max_distance, cull, out)
        if self._single_casts.geometry is not geometry:
            self._single_casts = ReusedCasts(geometry)
        return self._single_casts.cast(visible, rays, max_distance, cull, out)

    def prepare_readings(self, rays: Rays, visible: wp.array, limits: tuple[float, float]) -> Readings:
        """A cast whose hits are readings within these limits [m], valid while `visible` returns this array."""
        return prepare_readings(self._world.geometry, visible, rays, limits, self._body_of_shape)

    def prepare_hits(self, rays: Rays, visible: wp.array, limit: float, out: HitArrays) -> Readings:
        """A cast up to this limit [m] into these arrays, valid while `visible` returns this array."""
        return prepare_hits(self._world.geometry, visible, rays, limit, out)

    def hits(self, arrays: HitArrays, shape: tuple[int, ...]) -> Hits:
        """Hits from the arrays of a cast of rays of this shape."""
        return Hits(shape, arrays, self._shape_ids)
