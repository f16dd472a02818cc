"""Shapes that move between instants, and beams that are fired in the meantime."""

import numpy as np
import warp as wp
from made_worlds import Doubles, Plan, random_rotations, unit
from trimesh import transformations

from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.arrays import Rays

FIRINGS = 24
BEAMS = 960
Poses = tuple[Doubles, Doubles]


def rotation_about(axis: Doubles, angle: Doubles) -> Doubles:
    """Rotations (n, 3, 3) about axes (n, 3) by angles (n,) [rad]."""
    turned = [transformations.rotation_matrix(a, x)[:3, :3] for x, a in zip(axis, angle, strict=True)]
    return np.array(turned)


def moving(plan: Plan, seed: int, instants: int, step: float = 0.4, angle: float = 2.0) -> Poses:
    """Poses (instants, n, 3) and (instants, n, 3, 3) of a plan's shapes.

    Every third shape rests. Between instants, the others move at random by `step` [m] (standard deviation along each
    axis) and turn by up to `angle` [rad].
    """
    rng = np.random.default_rng(seed)
    position, rotation = (np.array(a) for a in plan.poses())
    positions, rotations = [position], [rotation.reshape(-1, 3, 3)]
    for _ in range(instants - 1):
        goes = (np.arange(len(position)) % 3 > 0)[:, None]
        positions.append(positions[-1] + goes * rng.normal(scale=step, size=position.shape))
        angles = rng.uniform(0, angle, len(position)) * goes[:, 0]
        rotations.append(rotation_about(rng.normal(size=position.shape), angles) @ rotations[-1])
    return np.array(positions), np.array(rotations)


def fired(seed: int, spans: int, packets: bool, worlds: int = 1) -> Rays:
    """Beams in FIRINGS firings, each with a random span of its world, fraction of it and pose of the sensor."""
    rng = np.random.default_rng(seed)
    directions = unit(rng.normal(size=(BEAMS, 3)))
    firing = np.sort(rng.integers(0, FIRINGS, BEAMS)).astype(np.int32)
    count = worlds * FIRINGS
    span = rng.integers(0, spans, count) + spans * np.repeat(np.arange(worlds), FIRINGS)
    fraction = rng.random(count)
    fraction[:3] = 0, 1, 0.5
    return Rays(
        wp.array(directions, dtype=wp.vec3d, device="cpu"),
        wp.zeros(1, dtype=wp.vec3d, device="cpu"),
        wp.array(rng.uniform(-2, 2, (count, 3)), dtype=wp.vec3d, device="cpu"),
        wp.array(random_rotations(rng, count), dtype=wp.mat33d, device="cpu"),
        packets=sort_into_packets(directions, firing) if packets else None,
        worlds=worlds,
        firing=wp.array(firing, dtype=int, device="cpu"),
        span=wp.array(span, dtype=int, device="cpu"),
        fraction=wp.array(fraction, dtype=wp.float64, device="cpu"),
    )
