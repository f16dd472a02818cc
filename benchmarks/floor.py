"""The part of CUDA's trees that a ray must visit even if it knew its hit: a lower bound for any order of traversal."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from rigcast.bench.casters import Floats
from rigcast.bench.workloads import View, Workload, g1, hills, room, warehouse
from rigcast.bench.worlds.crowd import G1_HEAD, crowd
from rigcast.kernels.geometry import Geometry
from rigcast.kernels.packing.warps import WARP, sort_into_warps
from rigcast.kernels.shapes.solids import TRIANGLES
from rigcast.kernels.trees.fours import in_fours
from rigcast.kernels.trees.nodes import FIRST_PATCH, NO_CHILD, ends_of
from rigcast.kernels.world.stored_fours import StoredFours
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.filter import Filter

WARPS, WORLDS = 8, 32
NODE, BLOCK, PATCH, RAY = 112, 416, 64, 48  # bytes
NODE_OPERATIONS, BLOCK_OPERATIONS = 4 * 15, 8 * 60


@dataclass(frozen=True)
class Visits:
    """Nodes, blocks of meshes and patches of height fields of a ray, on average; and those of a warp of 32 neighbours,
    each counted once, over its rays."""

    name: str
    nodes: float
    blocks: float
    patches: float
    in_warp: tuple[float, float, float]

    @property
    def bytes(self) -> float:
        return _bytes(self.nodes, self.blocks, self.patches)

    @property
    def bytes_in_warp(self) -> float:
        return _bytes(*self.in_warp)

    @property
    def operations(self) -> float:
        return NODE_OPERATIONS * self.nodes + BLOCK_OPERATIONS * (self.blocks + self.patches)


def _bytes(nodes: float, blocks: float, patches: float) -> float:
    return RAY + NODE * nodes + BLOCK * blocks + PATCH * patches


def visits() -> list[Visits]:
    """Count for the lidars of three scenes."""
    return [_visits(workload) for workload in (warehouse(), room(), hills(1_000_000))]


def visits_in_worlds() -> Visits:
    """Count for the lidar of `rigcast bench worlds`. Raises Unavailable without the robot."""
    robots = crowd(g1(), G1_HEAD, WORLDS)
    model, seen = robots.workload.model, robots.lidar.filter
    scene, looked = Scene(model, "cpu"), []
    poses: Any = Rig(model, [robots.lidar], "cpu").sense(robots.on_device(WORLDS, scene.device))["lidar"].pose
    for world, pose in enumerate(poses.numpy()):
        scene.update(robots.data(world))
        warps = _in_warps(robots.directions) @ pose[:3, :3].T
        looked.append(_looked_at(scene, seen, pose[:3, 3], warps[world % len(warps)]))
    return _average("a G1 in many worlds, lidar", looked)


def _visits(workload: Workload) -> Visits:
    scene = Scene(workload.model, "cpu")
    scene.update(workload.data)
    view: View = next(view for view in workload.views if view.sensor == "lidar")
    seen, warps = Filter(geom_groups=workload.groups), _in_warps(view.directions.reshape(-1, 3))
    some = np.linspace(0, len(warps) - 1, WARPS).astype(int)
    return _average(f"{workload.name}, lidar", [_looked_at(scene, seen, view.origin, warps[k]) for k in some])


def _in_warps(directions: Floats) -> Floats:
    """Return rays (n / WARP, WARP, 3) as CUDA casts them."""
    return directions[sort_into_warps(directions, "cpu").order.numpy()].reshape(-1, WARP, 3)


_Looked = tuple[set[int], set[int]]
"""The nodes and the leaves of triangle trees that a ray enters; node k of the tree over shapes is ~k."""


def _average(name: str, warps: Sequence[Sequence[_Looked]]) -> Visits:
    nodes, blocks, patches = np.mean([_numbers(*ray) for warp in warps for ray in warp], axis=0).tolist()
    of_warps = [_numbers(*(set[int]().union(*each) for each in zip(*warp, strict=True))) for warp in warps]
    return Visits(name, nodes, blocks, patches, tuple((np.mean(of_warps, axis=0) / WARP).tolist()))


def _numbers(nodes: set[int], leaves: set[int]) -> tuple[int, int, int]:
    patches = sum(leaf >= FIRST_PATCH for leaf in leaves)
    return len(nodes), len(leaves) - patches, patches


def _looked_at(scene: Scene, seen: Filter, origin: Floats, rays: Floats) -> list[_Looked]:
    reach = scene.cast(origin, rays, filter=seen).numpy().distance.astype(float)
    visible = scene.visible(seen).numpy()
    trees = _trees_of(scene)
    return [_of_ray(scene, trees, visible, origin, d, t) for d, t in zip(rays, reach, strict=True)]


class _Trees(NamedTuple):
    """The tree over shapes, those over triangles, and the root of each shape's."""

    top: npt.NDArray[np.void]
    of_triangles: npt.NDArray[np.void]
    root: npt.NDArray[np.int_]


def _trees_of(scene: Scene) -> _Trees:
    world: Any = scene._world
    stored: Any = Geometry()
    roots = StoredFours(stored, world.trees, world.device).roots
    top = world.geometry.top.numpy()
    return _Trees(
        in_fours(top["child"], *ends_of(top)), stored.fours.numpy(), np.array([*roots, 0])[world._tree_of_shape]
    )


def _of_ray(
    scene: Scene, trees: _Trees, visible: npt.NDArray[np.bool_], origin: Floats, direction: Floats, reach: float
) -> _Looked:
    g: Any = scene._world.geometry
    kind, position, rotation = g.kind.numpy(), g.position.numpy(), g.rotation.numpy()
    nodes, shapes = _entered(trees.top, 0, origin - g.anchor.numpy()[0], direction, reach)
    looked: _Looked = {~node for node in nodes}, set()
    for shape in shapes:
        if visible[shape] and kind[shape] == TRIANGLES:
            turn = rotation[shape]
            local = turn.T @ (origin - position[shape]), turn.T @ direction
            for found, more in zip(looked, _entered(trees.of_triangles, trees.root[shape], *local, reach), strict=True):
                found.update(more)
    return looked


def _entered(
    tree: npt.NDArray[np.void], root: int, origin: Floats, direction: Floats, reach: float
) -> tuple[Sequence[int], Sequence[int]]:
    """Return which nodes, and which leaves, a ray enters within a distance `reach` [m]."""
    stack, nodes, leaves = [int(root)], list[int](), list[int]()
    with np.errstate(divide="ignore", invalid="ignore"):
        while stack:
            nodes.append(stack.pop())
            node = tree[nodes[-1]]
            ends = np.array([[node[f"{end}_{axis}"] for axis in "xyz"] for end in ("lower", "upper")])
            ways = (ends - origin[:, None]) / direction[:, None]
            enter, leave = np.nanmax(ways.min(axis=0), axis=0), np.nanmin(ways.max(axis=0), axis=0)
            is_met = (enter <= leave) & (leave >= 0) & (enter <= reach) & (node["child"] != NO_CHILD)
            for child in node["child"][is_met]:
                (stack if child >= 0 else leaves).append(int(child if child >= 0 else ~child))
    return nodes, leaves
