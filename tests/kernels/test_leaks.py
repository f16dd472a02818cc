"""Meshes without holes let no ray through that is aimed exactly at their vertices or edges."""

import numpy as np
import pytest
from made_worlds import (
    Doubles,
    Mesh,
    Plan,
    cast_through,
    cube,
    grid,
    icosphere,
    mesh,
    random_rotations,
    turned,
    unit,
    world_of,
)
from moeller_trumbore import dot, norm
from numpy.typing import NDArray

from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE

INF = np.inf
LEAK_RAYS = 15_000
POSES = {"at the origin": (0.0, False), "posed": (10.0, True), "far": (1e5, True)}


def check_targets_are_hit(shape: Mesh, origins: Doubles, targets: Doubles, pose: str) -> None:
    """Assert that no ray gets farther than its target."""
    far, is_turned = POSES[pose]
    position = far * np.array([1.0, -0.7, 0.3])
    rotation = random_rotations(np.random.default_rng(5), 1)[0] if is_turned else np.eye(3)
    plan = Plan()
    plan.add_mesh(shape, position, rotation)
    o, p = (a @ rotation.T + position for a in (origins, targets))
    got = cast_through(plan.world(), o, unit(p - o))
    expected = norm(p - o)
    leaks = ~(got.distance <= expected + 1e-4 * (1 + expected))
    assert not leaks.any(), (
        f"{leaks.sum()} of {len(leaks)} rays leak, ray {np.flatnonzero(leaks)[0]} got "
        f"{got.distance[leaks][0]}, expected {expected[leaks][0]}"
    )


def edge_points(
    shape: Mesh, rng: np.random.Generator, count: int, usable: NDArray[np.bool_], off: float = 0
) -> Doubles:
    """Points at vertices and on edges (their middles, anywhere, or close to a vertex), in float64.

    Args:
        usable: (faces, 3) which edges, from corner k to the next.
        off: least distance from the ends, as a fraction of the edge.
    """
    face, first = np.argwhere(usable)[rng.integers(0, int(usable.sum()), count)].T
    a, b = (shape.corners[face, (first + k) % 3].astype(np.float64) for k in (0, 1))
    along = rng.choice([0.0, 0.5, 1.0], count)
    along = np.where(rng.random(count) < 0.5, along, rng.random(count))
    along = np.where(rng.random(count) < 0.1, 10 ** rng.uniform(-9, -3, count), along)
    return np.asarray(a + np.clip(along, off, 1 - off)[:, None] * (b - a))


def edges_within(faces: NDArray[np.int64], chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(faces, 3) edges that two of the chosen faces share."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
    code = ends[..., 0] * (faces.max() + 1) + ends[..., 1]
    shared, count = np.unique(code[chosen], return_counts=True)
    return chosen[:, None] & np.isin(code, shared[count == 2])


CLOSED = {
    "cube": cube(),
    "turned cube": turned(cube(), 1),
    "icosphere": icosphere(3),
    "turned icosphere": turned(icosphere(3), 2),
}


@pytest.mark.parametrize("pose", ["at the origin", "posed", "far"])
@pytest.mark.parametrize("name", CLOSED)
def test_no_ray_leaves_a_closed_mesh(name: str, pose: str) -> None:
    """From inside, aimed exactly at vertices and edges. A leak is a miss: there is nothing else to hit."""
    shape, rng = CLOSED[name], np.random.default_rng(0)
    targets = edge_points(shape, rng, LEAK_RAYS, np.ones(shape.faces.shape, bool))
    origins = rng.uniform(-0.5, 0.5, (LEAK_RAYS, 3))
    origins[::2] = np.round(origins[::2] * 4) / 4  # in planes of the grid
    check_targets_are_hit(shape, origins, targets, pose)


@pytest.mark.parametrize("pose", ["at the origin", "posed"])
@pytest.mark.parametrize("name", CLOSED)
def test_no_ray_enters_a_closed_mesh(name: str, pose: str) -> None:
    """From outside, at edges and vertices between faces that face the origin. A leak hits the far side."""
    shape, rng = CLOSED[name], np.random.default_rng(1)
    corners = shape.corners.astype(np.float64)
    normals = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    for origin in 3 * unit(rng.normal(size=(8, 3))):
        is_front = dot(normals, unit(origin - corners[:, 0])) > 0.05
        edges = edges_within(shape.faces, is_front)
        targets = [edge_points(shape, rng, LEAK_RAYS // 16, edges, off=0.01)]
        is_inner = np.asarray(~np.isin(shape.faces, shape.faces[~is_front]).any(axis=1))
        if is_inner.any():
            targets.append(edge_points(shape, rng, LEAK_RAYS // 16, np.repeat(is_inner[:, None], 3, axis=1)))
        aims = np.concatenate(targets)
        check_targets_are_hit(shape, np.broadcast_to(origin, aims.shape), aims, pose)


@pytest.mark.parametrize("pose", ["at the origin", "posed"])
@pytest.mark.parametrize("bumps", [0.0, 0.05], ids=["flat", "bumpy"])
@pytest.mark.parametrize("is_turned", [False, True])
def test_no_ray_goes_through_a_grid(is_turned: bool, bumps: float, pose: str) -> None:
    flat = grid(16, bumps)
    shape = turned(flat, 3) if is_turned else flat
    rng = np.random.default_rng(2)
    is_inner = np.asarray((np.abs(flat.corners[..., :2]) < 0.999).all(axis=(1, 2)))
    targets = edge_points(shape, rng, LEAK_RAYS, np.repeat(is_inner[:, None], 3, axis=1))
    up = turned(mesh([(0, 0, 1)], []), 3).vertices[0].astype(np.float64) if is_turned else np.array([0.0, 0, 1])
    beside = rng.normal(size=(LEAK_RAYS, 3)) * 0.5
    beside[::2] = 0  # straight down on it
    check_targets_are_hit(shape, targets + 3 * up + beside, targets, pose)


def test_no_axis_parallel_ray_that_runs_along_the_faces_of_boxes_is_lost() -> None:
    """Level beams of a lidar can start in the plane of a box's face, where a naive slab test computes 0 * inf."""
    shape = grid(8)
    standing = shape._replace(vertices=np.ascontiguousarray(shape.vertices[:, [2, 0, 1]]))  # in the plane x = 0
    y, z = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-1, 1, 17)[1:-1]]))
    for sign in (1, -1):
        origins = np.stack([0 * y + 2 * sign, y, z], axis=-1)
        got = cast_through(world_of(standing), origins, (-sign, 0, 0))
        assert (got.distance == 2).all()


@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT])
def test_ray_within_a_face_hits_a_side_or_nothing(cull: int) -> None:
    """Either is right; any other distance is not."""
    got = cast_through(
        world_of(cube()), [(5, 0.5, 1), (0.5, 5, -1), (1, 1, 5), (-1, 5, 1)], -np.eye(3)[[0, 1, 2, 1]], cull=cull
    )
    side = 6 if cull == CULL_FRONT else 4
    assert all(t == INF or abs(t - side) < 1e-5 for t in got.distance), got.distance
    hit = got.shape >= 0
    np.testing.assert_array_equal(hit, got.distance < INF)
    np.testing.assert_allclose(norm(got.normal.astype(np.float64)), hit, atol=1e-6)
