"""The fields that a cast writes beside its hits equal those computed from the hits afterwards, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_rays import RAYS
from made_worlds import random_plan, random_rotations

from rigcast.kernels.cast import cast, launch, prepare_readings
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.out import FIELD_NAMES
from rigcast.kernels.hits.reading import look_up, points, z_depth
from rigcast.kernels.packets import cast as casting
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.triangle import CULL_NONE

SEED = 2


def in_two_poses(rays: Rays, rng: np.random.Generator) -> Rays:
    """The rays in two worlds; the sensor's pose in the second is not finite."""
    position = np.array([rng.uniform(-1, 1, 3), np.full(3, np.nan)])
    rotation = random_rotations(rng, 2)
    return replace(
        rays,
        position=wp.array(position, dtype=wp.vec3d, device="cpu"),
        rotation=wp.array(rotation, dtype=wp.mat33d, device="cpu"),
        span=wp.zeros(2, dtype=int, device="cpu"),
        worlds=2,
    )


@pytest.mark.parametrize("names", [FIELD_NAMES, *((name,) for name in FIELD_NAMES)], ids=["all", *FIELD_NAMES])
@pytest.mark.parametrize(("streamed_from", "before"), [(0, 0), (0, 1), (2**40, 0)], ids=["streamed", "1 on", "plain"])
@pytest.mark.parametrize("kind", RAYS)
def test_fields_are_those_of_the_hits(
    kind: str, streamed_from: int, before: int, names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(casting, "STREAMED_FROM", streamed_from)
    world, rng = random_plan(SEED).world(), np.random.default_rng(SEED)
    rays, shapes = in_two_poses(RAYS[kind](), rng), len(world.geometry.kind)
    seen = wp.full(shapes, True, dtype=wp.bool, device="cpu")
    body_of_shape = wp.array(rng.integers(-1, 9, shapes), dtype=int, device="cpu")
    distance = cast(world.geometry, seen, rays, np.inf, CULL_NONE).distance.numpy()
    near, far = np.quantile(distance[np.isfinite(distance)], (0.2, 0.8)).tolist()

    hits = HitArrays.empty(rays.total, "cpu")
    readings = prepare_readings(world.geometry, seen, rays, (near, far), body_of_shape)
    every = {
        "points": wp.full(before + rays.total, wp.vec3(7.0), dtype=wp.vec3, device="cpu"),
        "depth": wp.full(before + rays.total, 7.0, dtype=float, device="cpu"),
        "body_id": wp.full(before + rays.total, 7, dtype=int, device="cpu"),
    }
    own = {name: array[before:] for name, array in every.items()}
    readings.turn_to(hits, rays, own)
    readings.turn_to(hits, rays, {name: own[name] for name in names})
    launch([readings])

    assert {-np.inf, np.inf} < set(hits.distance.numpy().tolist()), (
        f"seed {SEED}: no ray is too near, or none is too far"
    )
    expected = {
        "points": points(hits.distance, rays),
        "depth": z_depth(hits.distance, rays),
        "body_id": look_up(body_of_shape, hits.shape),
    }
    for name, array in every.items():
        got = array.numpy()
        assert (got[:before] == 7).all(), name
        if name in names:
            assert got[before:].tobytes() == expected[name].numpy().tobytes(), f"seed {SEED}: {name}"
        else:
            assert (got == 7).all(), name
