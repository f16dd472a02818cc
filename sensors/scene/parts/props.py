"""The props of a scene as a part of it."""

from collections import Counter
from collections.abc import Iterable, Sequence

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.geometry import Shapes, TriangleTree
from rigcast.kernels.poses.mounts import Frames
from rigcast.kernels.shapes import solids
from rigcast.sensors.errors import InputError, require_type, warn_user
from rigcast.sensors.faults import refuse
from rigcast.sensors.scene.batch.attached import Attached
from rigcast.sensors.scene.batch.standing import Standing
from rigcast.sensors.scene.cache.trees import cached_triangle_tree
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop

from .lost import Lost
from .part import Owner, Snapshot


class Props:
    """Shape k is prop k, a triangle tree in the frame of its mount. Props of one file and scale share a tree."""

    owner: Owner = "prop"

    def __init__(self, model: mujoco.MjModel, given: Iterable[Prop], device: wp.Device) -> None:
        props = as_props(given)
        for prop in props:
            refuse(f"prop {prop.name!r}", prop.faults(model))
        self.model = model
        meshes = list(dict.fromkeys((prop.file, prop.scale) for prop in props))
        first = {(prop.file, prop.scale): prop for prop in reversed(props)}
        self.trees = [_build(first[mesh]) for mesh in meshes]
        self.shapes = _shapes([meshes.index((prop.file, prop.scale)) for prop in props], self.trees)
        self._mounts = [prop.mount.bind(model) for prop in props]
        self._attached = [Attached.by([mount], device) for mount in self._mounts]
        self.ids = np.arange(len(props), dtype=np.int32)
        self.bodies = np.array([mount.body_id for mount in self._mounts], np.int32)
        self._lost = Lost(lambda k: f"prop {props[k].name!r}")

    def update(self, data: mujoco.MjData) -> Snapshot:
        poses = np.array([mount.pose(data) for mount in self._mounts]).reshape(-1, 4, 4)
        is_finite = np.isfinite(poses).all(axis=(1, 2))
        self._lost.warn(data.time, is_finite)
        position = np.where(is_finite[:, None], poses[:, :3, 3], np.nan)
        return Snapshot(position, poses[:, :3, :3].reshape(-1, 9))

    def poses_after_geoms(self, worlds: Standing) -> Frames:
        """(nworld, ngeom + n): those of the geoms, then of the props."""
        first = self.model.ngeom
        frames = Frames.empty(worlds.count, first + len(self._attached), worlds.device)
        frames.copy(worlds.geoms_on_device)
        for k, attached in enumerate(self._attached):
            frames.place(first + k, worlds.carriers(attached), attached.on)
        return frames

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        return ~filter.hidden_bodies(self.model)[self.bodies]


def as_props(given: object) -> tuple[Prop, ...]:
    """Raises InputError for anything but a list of props with different names."""
    if isinstance(given, Prop) or not isinstance(given, Iterable):
        raise InputError(f"props: got {type(given).__name__}, expected a list of props")
    props = tuple(given)
    for k, prop in enumerate(props):
        require_type(f"props[{k}]", prop, Prop)
    repeated = [name for name, n in Counter(prop.name for prop in props).items() if n > 1]
    if repeated:
        raise InputError(f"props: names must differ, got {', '.join(map(repr, repeated))} more than once")
    return props


def _build(prop: Prop) -> TriangleTree:
    try:
        tree = cached_triangle_tree(*prop.triangles())
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"prop {prop.name!r}: {prop.file}: scaled by {prop.scale}: {error}") from None
    if not len(tree.blocks):
        raise InputError(f"prop {prop.name!r}: {prop.file}: no triangle in it has an area")
    if tree.dropped:
        message = f"prop {prop.name!r}: {prop.file}: {tree.dropped} triangles without area left out"
        warn_user(message, UserWarning)
    return tree


def _shapes(tree: Sequence[int], trees: Sequence[TriangleTree]) -> Shapes:
    lower = np.array([trees[k].lower for k in tree], np.float64).reshape(-1, 3)
    upper = np.array([trees[k].upper for k in tree], np.float64).reshape(-1, 3)
    center = ((lower + upper) / 2).astype(np.float32)
    # float64 to float32 may round a half size down
    half = np.maximum(upper - center, center - lower) * (1 + 1e-6)
    kind = np.full(len(tree), solids.TRIANGLES, np.int32)
    size = np.zeros((len(tree), 3), np.float32)
    return Shapes(kind, size, np.array(tree, np.int32), center, half.astype(np.float32))
