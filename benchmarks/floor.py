"""How much of the trees a ray has to look at even if it knew its hit: what no order of the visit can go below."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rigcast.bench.casters import Floats
from rigcast.bench.workloads import View, Workload, hills, room, warehouse
from rigcast.kernels.shapes.solids import TRIANGLES
from rigcast.kernels.trees.nodes import FIRST_PATCH
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.filter import Filter

RAYS = 200
NODE, BLOCK, PATCH, RAY = 224, 416, 64, 48  # bytes
NODE_OPERATIONS, BLOCK_OPERATIONS = 8 * 15, 8 * 60


@dataclass(frozen=True)
class Visits:
    """Nodes, blocks of meshes and patches of height fields of a ray, on average."""

    name: str
    nodes: float
    blocks: float
    patches: float

    @property
    def bytes(self) -> float:
        return RAY + NODE * self.nodes + BLOCK * self.blocks + PATCH * self.patches

    @property
    def operations(self) -> float:
        return NODE_OPERATIONS * self.nodes + BLOCK_OPERATIONS * (self.blocks + self.patches)


def visits() -> list[Visits]:
    """Count for the lidars of three scenes."""
    return [_visits(workload) for workload in (warehouse(), room(), hills(1_000_000))]


def _visits(workload: Workload) -> Visits:
    scene = Scene(workload.model, "cpu")
    scene.update(workload.data)
    view: View = next(view for view in workload.views if view.sensor == "lidar")
    every = view.directions.reshape(-1, 3)
    rays = every[np.linspace(0, len(every) - 1, RAYS).astype(int)]
    seen = Filter(geom_groups=workload.groups)
    reach = scene.cast(view.origin, rays, filter=seen).numpy().distance.astype(float)
    visible = scene.visible(seen).numpy()
    counts = [_of_ray(scene, visible, view.origin, d, t) for d, t in zip(rays, reach, strict=True)]
    return Visits(f"{workload.name}, lidar", *np.mean(counts, axis=0).tolist())


def _of_ray(
    scene: Scene, visible: npt.NDArray[np.bool_], origin: Floats, direction: Floats, reach: float
) -> tuple[int, int, int]:
    g: Any = scene._world.geometry
    kind, root = g.kind.numpy(), g.root.numpy()
    position, rotation = g.position.numpy(), g.rotation.numpy()
    nodes, shapes = _entered(g.top.numpy(), 0, origin - g.anchor.numpy()[0], direction, reach)
    met: list[int] = []
    for shape in shapes:
        if visible[shape] and kind[shape] == TRIANGLES:
            turn = rotation[shape]
            local = turn.T @ (origin - position[shape]), turn.T @ direction
            more, leaves = _entered(g.nodes.numpy(), root[shape], *local, reach)
            nodes, met = nodes + more, [*met, *leaves]
    patches = sum(leaf >= FIRST_PATCH for leaf in met)
    return nodes, len(met) - patches, patches


def _entered(
    tree: npt.NDArray[np.void], root: int, origin: Floats, direction: Floats, reach: float
) -> tuple[int, Sequence[int]]:
    """Return how many nodes, and which leaves, a ray enters before it has come `reach` [m] far."""
    stack, count = [int(root)], 0
    leaves: list[int] = []
    with np.errstate(divide="ignore", invalid="ignore"):
        while stack:
            node = tree[stack.pop()]
            count += 1
            center = np.stack([node[f"center_{axis}"] for axis in "xyz"])
            half = np.stack([node[f"half_{axis}"] for axis in "xyz"])
            towards = (center - origin[:, None]) / direction[:, None]
            across = np.abs(half / direction[:, None]) * np.sign(half)
            enter, leave = np.nanmax(towards - across, axis=0), np.nanmin(towards + across, axis=0)
            is_met = (enter <= leave) & (leave >= 0) & (enter <= reach) & (half[0] >= 0)
            for child in node["child"][is_met]:
                (stack if child >= 0 else leaves).append(int(child if child >= 0 else ~child))
    return count, leaves
