"""Sensors whose casts are launched at once, and the check that each reads what it reads alone."""

from collections.abc import Sequence

import numpy as np
import warp as wp
from made_rays import PATTERNS, RAYS, START
from made_worlds import Hits, assert_same, rays_of

from rigcast.kernels.cast import Readings, launch, prepare_readings
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.world.world import World

SEED = 4
FEW = PATTERNS["all around"][:7]


def rays_of_sensors() -> list[Rays]:
    """Rays of sensors of every kind and of different numbers; the last sensor has none."""
    return [*(make() for make in RAYS.values()), rays_of(START, FEW), rays_of(START, np.empty((0, 3)))]


def prepared(world: World, sensors: Sequence[Rays]) -> list[tuple[Readings, HitArrays]]:
    """A reading of each sensor, each with its own visible shapes and limit."""
    no_bodies = wp.empty(0, dtype=int, device="cpu")
    readings = []
    for k, rays in enumerate(sensors):
        seen = np.random.default_rng(k).random(len(world.geometry.kind)) < 0.7
        visible = wp.array(seen, dtype=wp.bool, device="cpu")
        reading = prepare_readings(world.geometry, visible, rays, (0.5, 4.0 + k), no_bodies)
        hits = HitArrays.empty(rays.total, "cpu")
        reading.turn_to(hits, rays, {})
        readings.append((reading, hits))
    return readings


def taken(hits: HitArrays) -> Hits:
    """A copy of the hits, whose arrays are then set to 0."""
    arrays = hits.distance, hits.shape, hits.face, hits.normal
    copied = Hits(*(array.numpy().copy() for array in arrays))
    for array in arrays:
        array.fill_(0)
    return copied


def check_at_once(world: World, sensors: Sequence[Rays]) -> None:
    """Assert that sensors cast at once have the hits of each alone: all, some in another order, then all again."""
    readings = prepared(world, sensors)
    alone = []
    for reading, hits in readings:
        launch([reading])
        alone.append(taken(hits))
    every = list(range(len(readings)))
    for some in (every, every[::-2], every):
        launch([readings[k][0] for k in some])
        for k in some:
            assert_same(taken(readings[k][1]), alone[k])
    assert len({each.distance.tobytes() for each in alone}) == len(alone), (
        f"seed {SEED}: two sensors have the same hits"
    )
