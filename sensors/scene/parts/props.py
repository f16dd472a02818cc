"""The props of a scene as a part of it."""

from collections.abc import Iterable

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.shapes import solids
from rigcast.kernels.world.arrays import Shapes, TriangleTree
from rigcast.sensors.errors import InputError, warn_user
from rigcast.sensors.faults import refuse
from rigcast.sensors.scene.cache.trees import cached_triangle_tree
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop, as_props

from .lost import Lost
from .part import Owner, Snapshot


class Props:
    """Shape k is prop k, a triangle tree in the frame of its mount. Props of one file and scale share a tree.

    mounts: the mount of each prop on the model.
    """

    owner: Owner = "prop"

    def __init__(self, model: mujoco.MjModel, given: Iterable[Prop]) -> None:
        props = as_props(given)
        for prop in props:
            refuse(f"prop {prop.name!r}", prop.faults(model))
        self.model = model
        meshes = list(dict.fromkeys((prop.file, prop.scale) for prop in props))
        first = {(prop.file, prop.scale): prop for prop in reversed(props)}
        self.trees = [_build(first[mesh]) for mesh in meshes]
        tree = [meshes.index((prop.file, prop.scale)) for prop in props]
        self.shapes = Shapes.of_trees([solids.TRIANGLES] * len(props), tree, self.trees)
        self.mounts = [prop.mount.bind(model) for prop in props]
        self.ids = np.arange(len(props), dtype=np.int32)
        self.bodies = np.array([mount.body_id for mount in self.mounts], np.int32)
        self._lost = Lost(lambda k: f"prop {props[k].name!r}")

    def update(self, data: mujoco.MjData) -> Snapshot:
        poses = np.array([mount.pose(data) for mount in self.mounts]).reshape(-1, 4, 4)
        is_finite = np.isfinite(poses).all(axis=(1, 2))
        self._lost.warn(data.time, is_finite)
        position = np.where(is_finite[:, None], poses[:, :3, 3], np.nan)
        return Snapshot(position, poses[:, :3, :3].reshape(-1, 9))

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        return ~filter.hidden_bodies(self.model)[self.bodies]


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
