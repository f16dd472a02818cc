"""Any mesh is hit as brute force over its triangles in float64 says."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from made_worlds import Doubles, Mesh, Plan, cast_through, unit
from moeller_trumbore import moeller_trumbore
from numpy.typing import NDArray

SCALES = st.sampled_from([1e-6, 1e-3, 1.0, 1e3, 1e6])
GRID = st.integers(-4, 4).map(float)  # few places, so that vertices coincide, faces have no area, and rays meet edges
ANY = st.floats(-4, 4, width=32)
VERTICES = st.integers(3, 12).flatmap(lambda n: arrays(np.float32, (n, 3), elements=GRID | ANY))
RAYS = 64


def faces_of(vertices: NDArray[np.float32]) -> st.SearchStrategy[NDArray[np.int64]]:
    count = st.integers(0, 24)
    return count.flatmap(lambda m: arrays(np.int64, (m, 3), elements=st.integers(0, len(vertices) - 1)))


MESHES = VERTICES.flatmap(lambda v: st.builds(Mesh, st.just(v), faces_of(v)))


def sides(mesh: Mesh, origins: Doubles, directions: Doubles) -> tuple[Doubles, NDArray[np.bool_], NDArray[np.bool_]]:
    """(rays, faces): distance, whether a ray surely hits, and whether it may hit: it is near an edge or grazes."""
    a, b, c = (mesh.corners[:, k].astype(np.float64) for k in range(3))
    t, weights = moeller_trumbore(origins[:, None], directions[:, None], a, b, c)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=-1)
    edges = np.max([np.linalg.norm(e, axis=-1) for e in (a - b, b - c, c - a)], axis=0)
    reach = np.abs(mesh.corners).max(initial=0.0) + np.abs(origins).max()
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.abs(directions @ (normal / area[:, None]).T)
        # 1e-7 of the coordinates, as barycentric weights: over the slope and the height of a thin triangle
        room = 1e-7 * reach * edges / (area * slope)
    odd = ~(room < 1e-2) | ~(slope > 1e-5) | (np.abs(t) < 1e-5 * reach)
    least = weights.min(axis=-1)
    has_area = area > 0
    may = has_area & (odd | ((least > -room) & (t > -room * reach)))
    sure = has_area & ~odd & (least > room) & (t > 0)
    return t, sure, may


def bounds(mesh: Mesh, origins: Doubles, directions: Doubles, t: Doubles) -> Doubles:
    """(rays, faces): 3 eps (max_i |Vi - O| + t) / |cos|, as `kernels/shapes/triangle.py` promises; inf if it grazes."""
    a, b, c = (mesh.corners[:, k].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    away = np.linalg.norm(mesh.corners[None].astype(np.float64) - origins[:, None, None], axis=-1).max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.abs(directions @ (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).T)
        bound = 3 * 2.0**-23 * (away + np.abs(t)) / slope
    return np.where(np.isfinite(bound), bound, np.inf)


# A hit 0.02 um away on a triangle of 7 um: its distance is known to within a few 1e-12 m, not to 1e-5 of itself.
NEAR = Mesh(np.array([(2, 3, -1), (2.6660156, 4, 1), (-3, -2.4486814, 0)], np.float32), np.array([(0, 1, 2)]))


@example(mesh=NEAR, scale=1e-6, seed=11851)
@given(mesh=MESHES, scale=SCALES, seed=st.integers(0, 2**32 - 1))
def test_a_mesh_is_hit_where_brute_force_says(mesh: Mesh, scale: float, seed: int) -> None:
    mesh = Mesh((mesh.vertices * np.float32(scale)).astype(np.float32), mesh.faces)
    rng = np.random.default_rng(seed)
    origins = scale * rng.uniform(-6, 6, (RAYS, 3))
    directions = unit(scale * rng.uniform(-4, 4, (RAYS, 3)) - origins)
    plan = Plan()
    plan.add_mesh(mesh)
    got = cast_through(plan.world(), origins, directions)
    t, sure, may = sides(mesh, origins, directions)
    bound = bounds(mesh, origins, directions, t)
    farthest = np.add(t, bound, out=np.full_like(t, np.inf), where=sure)
    nearest_sure = farthest.min(axis=1, initial=np.inf)
    hit = got.face >= 0
    assert (got.distance <= nearest_sure).all(), "a sure hit was missed"
    rays = np.flatnonzero(hit)
    assert may[rays, got.face[rays]].all(), "a hit on a face that brute force misses"
    certain = rays[sure[rays, got.face[rays]]]
    named = certain, got.face[certain]
    assert (np.abs(got.distance[certain] - t[named]) <= bound[named]).all(), "a distance is out of its bound"
    assert (got.distance[~hit] == np.inf).all()
