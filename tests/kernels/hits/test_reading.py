"""From hits to readings: range limits, points and depths in the sensor's frame, and ids."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from made_worlds import Doubles, random_plan, random_rotations, rays_of, unit

from rigcast.kernels.cast import cast, launch, prepare_readings
from rigcast.kernels.hits.arrays import HitArrays
from rigcast.kernels.hits.reading import bound, depth_16bit, look_up, points, read, world_points, z_depth
from rigcast.kernels.launching import slices
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes.triangle import CULL_NONE

INF, NAN = np.inf, np.nan
ROTATION = random_rotations(np.random.default_rng(0), 1)
POSITION = np.array([[1e5, -2e5, 3.0]])
DIRECTIONS = unit(np.random.default_rng(1).normal(size=(6, 3)))
RANGES = np.array([0.5, 2.0, 1e4, INF, -INF, NAN], np.float32)


def rays(origins: Doubles) -> Rays:
    arrays = zip((DIRECTIONS, origins, POSITION, ROTATION), (wp.vec3d, wp.vec3d, wp.vec3d, wp.mat33d), strict=True)
    return Rays(*(wp.array(a, dtype=dtype, device="cpu") for a, dtype in arrays))


def device(values: np.ndarray, dtype: type) -> wp.array:
    return wp.array(values, dtype=dtype, device="cpu")


ORIGINS = pytest.mark.parametrize(
    "origins", [np.zeros((1, 3)), np.random.default_rng(2).normal(size=(6, 3))], ids=["one origin", "an origin each"]
)


@pytest.mark.parametrize("min_range", [0.0, 0.5, 1.0])
def test_hits_nearer_than_the_least_range_are_minus_inf_and_normals_turn_into_the_frame(min_range: float) -> None:
    distance = np.array([0.5, 2.0, 1e4, INF, 0.0, NAN], np.float32)
    shape = np.array([3, 4, 5, -1, 6, -1], np.int32)
    normal = np.where(shape[:, None] >= 0, unit(np.random.default_rng(3).normal(size=(6, 3))), 0)
    face = device(np.arange(6), wp.int32)
    hits = HitArrays(device(distance, wp.float32), device(shape, wp.int32), face, device(normal, wp.vec3))
    read(hits, rays(np.zeros((1, 3))), min_range)
    is_near = distance < min_range
    np.testing.assert_array_equal(hits.distance.numpy(), np.where(is_near, -INF, distance))
    np.testing.assert_array_equal(hits.shape.numpy(), np.where(is_near, -1, shape))
    np.testing.assert_allclose(
        hits.normal.numpy(), np.where(is_near[:, None], 0, normal @ ROTATION[0]), atol=1e-6, rtol=0
    )


def test_measured_distances_out_of_the_limits_are_no_hits() -> None:
    distance = np.array([0.99, 1.0, 2.0, 5.0, 5.01, -3.0, INF, -INF, NAN], np.float32)
    hits = HitArrays.empty(len(distance), "cpu")
    hits.distance.assign(distance)
    hits.shape.fill_(3)
    hits.normal.fill_(wp.vec3(0.0, 0.6, 0.8))
    bound(hits, 1.0, 5.0)
    np.testing.assert_array_equal(hits.distance.numpy(), [-INF, 1, 2, 5, INF, -INF, INF, -INF, NAN])
    kept = [False, True, True, True, False, False, False, False, False]
    np.testing.assert_array_equal(hits.shape.numpy(), np.where(kept, 3, -1))
    np.testing.assert_array_equal(np.any(hits.normal.numpy() != 0, axis=1), kept)


@pytest.mark.parametrize("packed", [True, False], ids=["in packets", "alone"])
def test_what_a_cast_reads_is_its_hits_read_afterwards(packed: bool) -> None:
    world, directions = random_plan(3).world(), unit(np.random.default_rng(0).normal(size=(3000, 3)))
    turned = replace(rays_of(np.zeros(3), directions), rotation=device(ROTATION, wp.mat33d))
    rays = replace(turned, packets=sort_into_packets(directions) if packed else None)
    visible = device(np.ones(len(world.geometry.kind), bool), wp.bool)
    far = float(np.quantile(cast(world.geometry, visible, rays, INF, CULL_NONE).distance.numpy(), 0.6))
    expected, got = cast(world.geometry, visible, rays, far, CULL_NONE), HitArrays.empty(3000, "cpu")
    near = float(np.quantile(expected.distance.numpy(), 0.2))
    read(expected, rays, near)
    no_bodies = wp.empty(0, dtype=int, device="cpu")
    readings = prepare_readings(world.geometry, visible, rays, (near, far), no_bodies)
    readings.turn_to(got, rays, {})
    launch([readings])
    assert {-INF, INF} < set(got.distance.numpy().tolist()), "seed 3: no ray is too near, or none is too far"
    for name in ("distance", "shape", "normal"):
        np.testing.assert_array_equal(getattr(got, name).numpy(), getattr(expected, name).numpy(), err_msg=name)


@ORIGINS
def test_points_are_where_the_ranges_end_and_nan_where_there_is_none(origins: Doubles) -> None:
    in_frame = points(device(RANGES, wp.float32), rays(origins)).numpy()
    in_world = world_points(device(RANGES, wp.float32), rays(origins)).numpy()
    expected = (np.broadcast_to(origins, (6, 3)) + RANGES[:, None].astype(float) * DIRECTIONS)[:3]
    assert (in_frame.dtype, in_world.dtype) == (np.float32, np.float64)
    np.testing.assert_allclose(in_frame[:3], expected, rtol=1e-6)
    np.testing.assert_allclose(in_world[:3], expected @ ROTATION[0].T + POSITION, rtol=1e-14)
    assert np.isnan(in_frame[3:]).all()
    assert np.isnan(in_world[3:]).all()


def test_depth_is_the_range_along_z_and_infinite_where_it_is() -> None:
    forward = replace(rays(np.zeros((1, 3))), directions=device(np.abs(DIRECTIONS), wp.vec3d))
    got = z_depth(device(RANGES, wp.float32), forward).numpy()
    np.testing.assert_allclose(got[:3], RANGES[:3] * np.abs(DIRECTIONS[:3, 2]), rtol=1e-6)
    np.testing.assert_array_equal(got[3:], [INF, -INF, NAN])


def test_depth_in_steps_is_rounded_and_0_where_16_bits_do_not_hold_it() -> None:
    steps = np.array([0, 0.4, 0.6, 1, 65_535, 65_535.4, 65_535.6, -0.6, INF, -INF, NAN])
    got = depth_16bit(device(0.25 * steps, wp.float32), 0.25).numpy()
    np.testing.assert_array_equal(got, [0, 0, 1, 1, 65_535, 65_535, 0, 0, 0, 0, 0])


def test_looked_up_is_the_entry_of_the_table_and_minus_1_for_minus_1() -> None:
    got = look_up(device(np.array([10, 20, 30]), wp.int32), device(np.array([2, -1, 0, 0, 1, -1]), wp.int32)).numpy()
    np.testing.assert_array_equal(got, [30, -1, 10, 10, 20, -1])


THREE = replace(rays(np.zeros((1, 3))), directions=device(DIRECTIONS[:3], wp.vec3d))
NEAR = device(RANGES[:3], wp.float32)
INTO: dict[str, tuple[type, Callable[[wp.array], object]]] = {
    "points": (wp.vec3, lambda out: points(NEAR, THREE, out)),
    "points in the world": (wp.vec3d, lambda out: world_points(NEAR, THREE, out)),
    "depth": (wp.float32, lambda out: z_depth(NEAR, THREE, out)),
    "depth in steps": (wp.uint16, lambda out: depth_16bit(NEAR, 1.0, out)),
    "entries": (wp.int32, lambda out: look_up(device(np.arange(3), wp.int32), device(np.arange(3), wp.int32), out)),
    "limits": (wp.float32, lambda out: bound(replace(HitArrays.empty(3, "cpu"), distance=out), 9.0, INF)),
}


@pytest.mark.parametrize(("dtype", "write"), INTO.values(), ids=INTO)
def test_nothing_is_written_beside_an_array(dtype: type, write: Callable[[wp.array], object]) -> None:
    around = wp.full(5, dtype(7), dtype=dtype, device="cpu")
    write(around[1:4])
    got = around.numpy()
    assert (got[1:4] != 7).all()
    assert (got[[0, 4]] == 7).all()


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [1, slices.RAYS_PER_RUN, 200_003])
def test_every_ray_is_read_whatever_runs_and_threads_there_are(
    threads: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slices, "thread_count", lambda: threads)
    rng = np.random.default_rng(count)
    table, index = rng.integers(0, 1000, 50).astype(np.int32), rng.integers(0, 50, count).astype(np.int32)
    np.testing.assert_array_equal(look_up(device(table, wp.int32), device(index, wp.int32)).numpy(), table[index])
