"""The interface of a scene's parts: geoms, props, flexes and skins, each with its own shapes."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.world.arrays import Shapes, TriangleTree
from rigcast.sensors.specs.filter import Filter

Owner = Literal["geom", "flex", "skin", "prop"]
OWNERS: tuple[Owner, ...] = ("geom", "flex", "skin", "prop")


class ShapePoses(NamedTuple):
    """The poses of all shapes of a scene: position (n, 3) float64 [m], rotation (n, 9) float64 row-major."""

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


class Snapshot(NamedTuple):
    """A part as it stands now.

    position: (n, 3) float64 [m], rotation: (n, 9) float64 row-major, of its n shapes; NaN where one is never hit.
    shapes: given if sizes, boxes or trees have changed since the last snapshot. trees: the changed ones, by index.
    """

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]
    shapes: Shapes | None = None
    trees: Mapping[int, TriangleTree] = MappingProxyType({})


class Part(Protocol):
    """A kind of object that rays hit.

    owner: the field of a hit that names it, without `_id`. trees, shapes: as at the start; `shapes.tree` counts from
    this part's first tree. ids, bodies: (n,) int32, `owner_id` and `body_id` of each shape, -1 for no body.
    """

    owner: Owner
    trees: list[TriangleTree]
    shapes: Shapes
    ids: NDArray[np.int32]
    bodies: NDArray[np.int32]

    def update(self, data: mujoco.MjData) -> Snapshot:
        """The part in the state of `data`."""

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        """Which of its shapes (n,) a filter lets rays hit."""


def joined_poses(snapshots: Sequence[Snapshot]) -> ShapePoses:
    """The concatenated poses of all snapshots; those of a single one are not copied."""
    if len(snapshots) == 1:
        return ShapePoses(snapshots[0].position, snapshots[0].rotation)
    return ShapePoses(
        np.concatenate([snapshot.position for snapshot in snapshots]),
        np.concatenate([snapshot.rotation for snapshot in snapshots]),
    )


def joined_shapes(parts: Sequence[Part]) -> Shapes:
    """The concatenated shapes of all parts."""
    first_tree = np.cumsum([0, *(len(part.trees) for part in parts)])[:-1]
    return Shapes.joined([part.shapes for part in parts], first_tree)


def owners_and_ids(parts: Sequence[Part]) -> tuple[NDArray[np.str_], NDArray[np.int32]]:
    """Kind and id, (n,) each, of the object to which each shape of all parts belongs."""
    owners = np.concatenate([np.full(len(part.ids), part.owner) for part in parts])
    return owners, np.concatenate([part.ids for part in parts])
