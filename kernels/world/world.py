"""Moving shapes in one world or many, on one device.

Triangle trees are copied to the device once. Each update takes poses and refits the trees over the shapes there.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.host.upload import Upload

from .arrays import Shapes, TriangleTree
from .stored_fours import StoredFours
from .stored_trees import StoredTrees
from .top_trees import TopTrees

_SINGLE, _DOUBLE = (wp.vec3, wp.mat33), (wp.vec3d, wp.mat33d)

Poses = npt.NDArray[np.floating[Any]] | wp.array


class World:
    """Triangle trees and the shapes that place them, ready to be cast against as `geometry`.

    There may be many worlds of these shapes; their number is set by each update.
    """

    def __init__(self, trees: Sequence[TriangleTree], shapes: Shapes, device: wp.DeviceLike) -> None:
        self.device = wp.get_device(device)
        self.geometry = Geometry()
        self._trees: StoredTrees | StoredFours
        if self.device.is_cpu:
            self._trees = StoredTrees(self.geometry, trees)
        else:
            self._trees = StoredFours(self.geometry, trees, self.device)
        self._count = len(shapes.kind)
        self._uploads: tuple[Upload, Upload] | None = None
        self._part: slice | None = None
        self.set_shapes(shapes)
        self._top = TopTrees(self.geometry, self.device)

    @property
    def trees(self) -> list[TriangleTree]:
        """The triangle trees as given; on the CPU they share the triangles of `geometry`."""
        return self._trees.trees

    @property
    def bytes_per_world(self) -> int:
        """Bytes per world of a batch, besides its poses and, where these differ between worlds, sizes and boxes."""
        return self._top.bytes_per_tree

    @property
    def on_device(self) -> list[object]:
        """Owners of the arrays that updates and casts now use; a CUDA graph that repeats them must hold these."""
        geometry = Geometry()
        geometry.assign(self.geometry)
        return [geometry, self._top.launch]

    def set_shapes(self, shapes: Shapes) -> None:
        """Replace sizes and local boxes, with effect from the next update.

        shapes: the n shapes, whose number and kinds stay the same, or those of each of several worlds (W n,).
        """
        device = self.device
        self._tree_of_shape = shapes.tree
        self._of_shapes = {
            "size": wp.array(shapes.size, dtype=wp.vec3, device=device),
            "reach": wp.array(shapes.reach, dtype=float, device=device),
            "center": wp.array(shapes.center, dtype=wp.vec3, device=device),
            "half": wp.array(shapes.half, dtype=wp.vec3, device=device),
        }
        self._take_trees()
        self.geometry.kind = wp.array(shapes.kind[: self._count], dtype=int, device=device)
        self.geometry.twin = wp.array(_twins(shapes.kind[: self._count], shapes.tree[: self._count]), device=device)
        self._take_shapes(slice(0, len(shapes.kind)))
        self._poses: tuple[wp.array | None, wp.array | None] = (None, None)  # the next update takes all

    def set_tree(self, index: int, tree: TriangleTree) -> None:
        """Replace a triangle tree; shapes whose boxes change with it must be set, too."""
        if not self._trees.take(index, tree):
            self._take_trees()
            self._take_shapes(self._taken)

    def _take_shapes(self, part: slice) -> None:
        """Use part of the sizes and boxes that were set in the geometry."""
        self._taken = part
        for name, values in self._of_shapes.items():
            is_whole = part == slice(0, values.size)
            setattr(self.geometry, name, values if is_whole else values[part])

    def _take_trees(self) -> None:
        """Set each shape's tree and columns in the geometry; closed forms get arbitrary ones."""
        columns = [tree.columns for tree in self.trees]
        root, cells = (np.array([*each, 0], np.int32)[self._tree_of_shape] for each in (self._trees.roots, columns))
        self._of_shapes |= {
            "root": wp.array(root, dtype=int, device=self.device),
            "columns": wp.array(cells, dtype=int, device=self.device),
        }
        are_in_plots = not self._trees.have_nodes_of_plots and (cells.reshape(-1, max(1, self._count)) > 0).any(axis=0)
        self.geometry.hfields = wp.array(np.flatnonzero(are_in_plots), dtype=int, device=self.device)

    def update(self, position: Poses, rotation: Poses, part: slice | None = None) -> None:
        """Take the poses of the shapes of one world or many. A shape whose pose is not finite is never hit.

        Args:
            position: (n, 3) or (worlds, n, 3) [m], stored in float32 if it is float32, else in float64; or a Warp array
                on the world's device, (worlds, n) of vec3d or vec3. That is used in place: update again when its
                contents change.
            rotation: likewise (..., n, 9) or (..., n, 3, 3), row-major, or mat33d or mat33; columns are shapes' axes.
            part: the worlds to which these poses belong, among those for which sizes were set; None for all.

        Raises:
            ValueError: sizes were set for another number of worlds.
        """
        instants = self.geometry.instants
        if position is self._poses[0] and rotation is self._poses[1] and part == self._part and instants == 1:
            self._top.refit()
            return
        if instants > 1:
            self.geometry.movers, self.geometry.place = None, None
        self._fit(position, rotation, math.prod(_leading(position)), 1, part)

    def sweep(self, position: Poses, rotation: Poses) -> None:
        """Take the poses of the shapes at consecutive instants, between which they move as described in
        rigcast.kernels.poses.moving.

        Args:
            position: (instants, n, 3) or (worlds, instants, n, 3), else as for `update`. With S = instants - 1, the
                motion in world w between instants k and k + 1 is span w S + k.
            rotation: likewise. A shape whose pose is not finite at one end of a span is not hit in that span.
        """
        *worlds, instants = _leading(position)
        self._set_movers(_moves(position, rotation))
        self._fit(position, rotation, math.prod(worlds), instants)

    def _set_movers(self, moves: npt.NDArray[np.bool_]) -> None:
        """Set the movers of the geometry. moves: (n,) which shapes move."""
        place = np.where(moves, np.cumsum(moves) - 1, -1)
        self.geometry.movers = wp.array(np.flatnonzero(moves), dtype=int, device=self.device)
        self.geometry.place = wp.array(place, dtype=int, device=self.device)

    def _fit(self, position: Poses, rotation: Poses, worlds: int, instants: int, part: slice | None = None) -> None:
        count, sizes = self._count, self._of_shapes["size"].size
        if sizes > count:
            own = slice(0, sizes) if part is None else slice(part.start * count, part.stop * count)
            if own.stop - own.start != worlds * count:
                raise ValueError(f"got poses of {worlds} worlds, expected {sizes // count}, for which sizes were set")
            if own != self._taken:
                self._take_shapes(own)
        self._part = part
        self._set_poses(position, rotation)
        self._top.fit(worlds, instants)

    def _set_poses(self, position: Poses, rotation: Poses) -> None:
        if not isinstance(position, wp.array):
            position, rotation = self._uploaded(position, rotation)
        if position is self._poses[0] and rotation is self._poses[1]:
            return
        self._poses = position, rotation
        g, poses, is_double = self.geometry, (position.flatten(), rotation.flatten()), position.dtype is wp.vec3d
        g.position, g.rotation = poses if is_double else (None, None)
        g.position_float, g.rotation_float = (None, None) if is_double else poses

    def _uploaded(
        self, position: npt.NDArray[np.floating[Any]], rotation: npt.NDArray[np.floating[Any]]
    ) -> tuple[wp.array, wp.array]:
        """Copy the values to arrays of the world's own, which are reused while they fit."""
        count, dtypes = position.size // 3, _DOUBLE if position.dtype == np.float64 else _SINGLE
        if self._uploads is None or self._uploads[0].array.size != count or self._uploads[0].array.dtype != dtypes[0]:
            self._uploads = Upload(count, dtypes[0], self.device), Upload(count, dtypes[1], self.device)
        positions, rotations = self._uploads
        positions.write(position)
        rotations.write(rotation)
        return positions.array, rotations.array


def _twins(kind: npt.NDArray[np.int32], tree: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """For each shape (n,), the last earlier one with the same kind and triangle tree; -1 if there is none."""
    order = np.lexsort((kind, tree))
    before, after = order[:-1], order[1:]
    is_same = (tree[after] >= 0) & (tree[after] == tree[before]) & (kind[after] == kind[before])
    twins = np.full(len(kind), -1, np.int32)
    twins[after[is_same]] = before[is_same]
    return twins


def _leading(position: Poses) -> tuple[int, ...]:
    """The sizes of the axes before those of shapes and coordinates."""
    return tuple(position.shape[:-1] if isinstance(position, wp.array) else position.shape[:-2])


def _moves(position: Poses, rotation: Poses) -> npt.NDArray[np.bool_]:
    """Which shapes (n,) move between any two instants in any world; all of them if the poses are on the device."""
    *worlds, instants = _leading(position)
    if isinstance(position, wp.array) or isinstance(rotation, wp.array):
        return np.ones(position.shape[len(worlds) + 1], np.bool_)
    count = position.shape[-2]
    p = position.reshape(math.prod(worlds), instants, count, 3)
    r = rotation.reshape(math.prod(worlds), instants, count, 9)
    return np.asarray((p != p[:, :1]).any(axis=(0, 1, 3)) | (r != r[:, :1]).any(axis=(0, 1, 3)))
