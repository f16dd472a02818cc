"""Many worlds, with different poses of shapes and sensor in each."""

import numpy as np
import warp as wp
from made_worlds import Doubles, Plan, random_rotations, unit

from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.arrays import Rays

WORLDS = 7
BEAMS = 500
DIRECTIONS = unit(np.random.default_rng(0).normal(size=(BEAMS, 3)))


def scattered(plan: Plan, seed: int, worlds: int = WORLDS) -> tuple[Doubles, Doubles]:
    """Random poses of the plan's shapes in each world: (worlds, n, 3) and (worlds, n, 9)."""
    rng = np.random.default_rng(seed)
    position, _ = plan.poses()
    moved = position + rng.normal(scale=0.5, size=(worlds, *position.shape))
    return moved, random_rotations(rng, moved[..., 0].size).reshape(worlds, -1, 9)


def sensor_poses(seed: int, worlds: int = WORLDS) -> tuple[Doubles, Doubles]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (worlds, 3)), random_rotations(rng, worlds)


def sensor(position: Doubles, rotation: Doubles, packets: bool) -> Rays:
    """The beams, from a sensor in each world: position (worlds, 3), rotation (worlds, 3, 3)."""
    return Rays(
        wp.array(DIRECTIONS, dtype=wp.vec3d, device="cpu"),
        wp.zeros(1, dtype=wp.vec3d, device="cpu"),
        wp.array(position, dtype=wp.vec3d, device="cpu"),
        wp.array(rotation, dtype=wp.mat33d, device="cpu"),
        packets=sort_into_packets(DIRECTIONS) if packets else None,
        worlds=len(position),
    )
