"""What a scene is put together from: geoms, props, flexes and skins, each a part with shapes of its own."""

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
    """Where all shapes of a scene are: position (n, 3) float64 [m], rotation (n, 9) float64 row-major."""

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


class Snapshot(NamedTuple):
    """A part as it stands now.

    position: (n, 3) float64 [m], rotation: (n, 9) float64 row-major, of its n shapes; NaN where one is never hit.
    shapes: given where sizes, boxes or trees have changed since the last snapshot. trees: those that have, by index.
    """

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]
    shapes: Shapes | None = None
    trees: Mapping[int, TriangleTree] = MappingProxyType({})


class Part(Protocol):
    """A kind of thing that rays hit.

    owner: the field of a hit that names it, without `_id`. trees, shapes: as at the start; `shapes.tree` counts from
    this part's first tree. ids, bodies: (n,) int32, what `owner_id` and `body_id` read for each shape, -1 for no body.
    """

    owner: Owner
    trees: list[TriangleTree]
    shapes: Shapes
    ids: NDArray[np.int32]
    bodies: NDArray[np.int32]

    def update(self, data: mujoco.MjData) -> Snapshot:
        """The part in the state of `data`."""

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        """(n,) which of its shapes a filter lets rays hit."""


def joined_poses(snapshots: Sequence[Snapshot]) -> ShapePoses:
    """The poses of all; of one they are its own, not copied."""
    if len(snapshots) == 1:
        return ShapePoses(snapshots[0].position, snapshots[0].rotation)
    return ShapePoses(
        np.concatenate([snapshot.position for snapshot in snapshots]),
        np.concatenate([snapshot.rotation for snapshot in snapshots]),
    )


def joined_shapes(parts: Sequence[Part]) -> Shapes:
    """The shapes of all parts, one after the other."""
    first_tree = np.cumsum([0, *(len(part.trees) for part in parts)])[:-1]
    return Shapes.joined([part.shapes for part in parts], first_tree)


def owners_and_ids(parts: Sequence[Part]) -> tuple[NDArray[np.str_], NDArray[np.int32]]:
    """(n,) what kind of thing each shape of all parts is of, and its id among those."""
    owners = np.concatenate([np.full(len(part.ids), part.owner) for part in parts])
    return owners, np.concatenate([part.ids for part in parts])
