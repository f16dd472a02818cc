"""Rays whose answers are known by hand or from other projects' own tests."""

from typing import Literal

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
from judged_casts import Placed, assert_none_wrong, placed

from rigcast import Filter, oracle
from rigcast.oracle import Verdict

Vector = tuple[float, float, float]
Cull = Literal["none", "back", "front"]
INF = float("inf")


def loaded(xml: str) -> Placed:
    """Return the model of this MJCF, its initial state, and a scene in that state."""
    return placed(mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>"))


def check(
    world: Placed,
    ray: tuple[Vector, Vector],
    distance: float,
    geom_id: int,
    filter: Filter | None = None,
) -> None:
    """Assert that a ray meets this geom at this distance, and that mj_ray agrees."""
    model, data, scene = world
    hits = scene.cast(ray[0], [ray[1]], filter=filter).numpy()
    assert hits.geom_id[0] == geom_id, f"{ray}: got geom {hits.geom_id[0]} at {hits.distance[0]}"
    assert hits.distance[0] == pytest.approx(distance, abs=1e-5 * (1 + min(distance, 1e9)), rel=0)
    found = oracle.compare(model, data, ray[0], [ray[1]], hits, filter)
    assert found.verdict[0] != Verdict.WRONG, f"{ray}: got {found.got}, mj_ray {found.expected}"


BEADS = """
<worldbody>
  <geom type="sphere" size=".1" pos="1 0 0" group="0"/>
  <body pos="3 0 0"><freejoint/><geom type="sphere" size=".1" group="1"/></body>
  <geom type="sphere" size=".1" pos="5 0 0" group="2"/>
  <geom type="sphere" size=".1" pos="-1 0 0" group="3"/>
</worldbody>"""


@pytest.mark.parametrize(
    ("filter", "distance", "geom_id"),
    [
        (Filter(), 0.9, 0),
        (Filter(geom_groups=(1, 2)), 2.9, 2),
        (Filter(geom_groups=(2,)), 4.9, 1),
        (Filter(geom_groups=()), INF, -1),
        (Filter(static=False), 2.9, 2),
    ],
    ids=["all", "first group off", "second off", "all off", "static off"],
)
def test_groups_of_three_spheres(filter: Filter, distance: float, geom_id: int) -> None:
    world = loaded(BEADS)
    order = {-1: -1, 0: 0, 2: int(np.flatnonzero(world[0].geom_group == 1)[0])}
    order[1] = int(np.flatnonzero(world[0].geom_group == 2)[0])
    check(world, ((0, 0, 0), (1, 0, 0)), distance, order[geom_id], filter)


def test_a_sphere_from_inside_and_up_to_a_maximum_distance() -> None:
    world = loaded('<worldbody><geom type="sphere" size=".1" pos="-1 0 0"/></worldbody>')
    check(world, ((-1, 0, 0), (-1, 0, 0)), 0.1, 0)
    check(world, ((-0.5, 0, 0), (-1, 0, 0)), 0.4, 0)
    for max_distance, expected in ((0.41, 0.4), (0.4001, 0.4), (0.39, INF)):
        hits = world[2].cast((-0.5, 0, 0), [(-1, 0, 0)], max_distance=max_distance).numpy()
        assert hits.distance[0] == pytest.approx(expected, abs=1e-6), f"max_distance {max_distance}"
        assert (hits.geom_id[0] == -1) == np.isinf(expected)
        assert hits.normal[0].any() == np.isfinite(expected)


TETRAHEDRON = "1 1 1  -1 -1 1  -1 1 -1  1 -1 -1"
SHAPES = f"""
<asset>
  <mesh name="tetrahedron" scale=".4 .4 .4" vertex="{TETRAHEDRON}" face="0 1 3  0 2 1  0 3 2  1 2 3"/>
  <mesh name="ball" builtin="sphere" params="2" scale=".3 .3 .3"/>
  <hfield name="hill" nrow="3" ncol="2" elevation="1 2 3 3 2 1" size=".6 .4 .1 .1"/>
</asset>
<worldbody>
  <geom type="plane" size="4 4 4"/>
  <geom type="sphere" pos="0 0 1" size=".5"/>
  <geom type="capsule" pos="0 1 1" quat="0 .3826834 0 .9238795" size=".25 .5"/>
  <geom type="box" pos="1 0 1" quat="0 .3826834 0 .9238795" size=".5 .25 .3"/>
  <geom type="mesh" mesh="tetrahedron" pos="1 1 1" quat="0 0 .3826834 .9238795"/>
  <geom type="mesh" mesh="ball" pos="2 1 1"/>
  <geom type="hfield" hfield="hill" pos="0 2 1"/>
  <geom type="cylinder" pos="2 0 1" quat="0 0 .3826834 .9238796" size=".25 .5"/>
</worldbody>"""


@pytest.mark.parametrize(
    ("origin", "direction", "geom_id"),
    [
        ((2, 1, 3), (0.1, 0.2, -1), 0),
        ((2, 1, -0.5), (0.1, 0.2, -1), -1),
        ((2.03, 1, -0.5), (0, 0.05, 1), 5),
        ((0, 0, 1.6), (0.1, 0.2, -1), 1),
        ((0.5, 1, 1.6), (0, 0.05, -1), 2),
        ((-0.5, 1, 0.05), (0, 0.05, 1), 2),
        ((0, 1, 0.75), (1, 0, 0), 2),
        ((1, 0, 1.6), (0, 0.05, -1), 3),
        ((1, 0, 0.05), (0, 0.05, 1), 3),
        ((2, 2, 2), (-1, -1, -1), 4),
        ((4, 2, 2), (-2, -1, -1), 5),
        ((4, 2, 2), (2, 1, 1), -1),
        ((0, 2, 2), (0, 0, -1), 6),
        ((0.2, 2, 2), (0, 0, -1), 6),
        ((-0.2, 2, 2), (0, 0, -1), 6),
        ((0, 2.2, 2), (0, 0, -1), 6),
        ((0, 1.8, 2), (0, 0, -1), 6),
        ((2, 0.05, 2), (0.05, 0, -1), 7),
        ((2, 0.05, 0.1), (0.05, 0, 1), 7),
    ],
    ids=str,
)
def test_every_geom_type_from_outside(origin: Vector, direction: Vector, geom_id: int) -> None:
    """The rays of mujoco_warp's own tests, and similar ones, at similar shapes in the same places."""
    world = loaded(SHAPES)
    expected = oracle.Oracle(*world[:2]).cast(origin, [direction])
    assert expected.geom_id[0] == geom_id
    check(world, (origin, direction), float(expected.distance[0]), geom_id)


# One geom of each kind that holds the origin; `faces` says where +x enters from -4 and leaves again, None
# where it cannot (a plane has one side only).
SOLID = {
    "sphere": ('<geom type="sphere" size="1"/>', -1.0, 1.0),
    "capsule": ('<geom type="capsule" size=".5 2"/>', -0.5, 0.5),
    "ellipsoid": ('<geom type="ellipsoid" size="2 1 3"/>', -2.0, 2.0),
    "cylinder": ('<geom type="cylinder" size=".5 2"/>', -0.5, 0.5),
    "box": ('<geom type="box" size=".7 1 2"/>', -0.7, 0.7),
    "mesh": ('<geom type="mesh" mesh="cube"/>', -1.0, 1.0),
    "hfield": ('<geom type="hfield" hfield="slab"/>', -1.5, 1.5),
}
ASSETS = """<asset>
  <mesh name="cube" vertex="-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"/>
  <hfield name="slab" nrow="2" ncol="2" elevation="1 1 1 1" size="1.5 1.5 .5 .5"/>
</asset>"""
RAY_HEIGHT = {"hfield": -0.21}  # within the base box; rays at the others pass a little beside the centre
OUTSIDE, INSIDE = -4.0, 0.1


@pytest.mark.parametrize("kind", SOLID)
@pytest.mark.parametrize("start", [OUTSIDE, INSIDE], ids=["outside", "inside"])
@pytest.mark.parametrize("cull", ["none", "back", "front"])
def test_culling_drops_the_side_that_it_names(kind: str, start: float, cull: Cull) -> None:
    geom, enter, leave = SOLID[kind]
    _, _, scene = loaded(f"{ASSETS}<worldbody>{geom}</worldbody>")
    height = RAY_HEIGHT.get(kind, 1e-4)
    meets = {"none": (enter, leave), "back": (enter,), "front": (leave,)}[cull]
    ahead = [x for x in meets if x > start]
    hits = scene.cast((start, 1e-4, height), [(2.0, 0, 0)], cull=cull).numpy()
    expected = ahead[0] - start if ahead else INF
    assert hits.distance[0] == pytest.approx(expected, abs=1e-5)
    assert hits.geom_id[0] == (0 if ahead else -1)
    outward = 0.0 if not ahead else np.sign(ahead[0])
    np.testing.assert_allclose(hits.normal[0], (outward, 0, 0), atol=1e-3)


@pytest.mark.parametrize(
    ("height", "down", "cull", "distance"),
    [
        (1, True, "none", 1.0),
        (1, True, "back", 1.0),
        (1, True, "front", INF),
        (1, False, "none", INF),
        (-1, False, "none", INF),
        (-1, False, "back", INF),
        (-1, False, "front", INF),
        (-1, True, "none", INF),
    ],
)
def test_a_plane_has_one_side_under_every_cull(height: float, down: bool, cull: Cull, distance: float) -> None:
    _, _, scene = loaded('<worldbody><geom type="plane" size="0 0 1"/></worldbody>')
    hits = scene.cast((3, 4, height), [(0, 0, -1 if down else 1)], cull=cull).numpy()
    assert hits.distance[0] == pytest.approx(distance, abs=1e-6)


@pytest.mark.parametrize(
    ("size", "x", "y", "hit"),
    [
        ("0 0", 1e5, -1e5, True),
        ("1 2", 0.99, 1.99, True),
        ("1 2", 1.01, 0, False),
        ("1 2", 0, -2.01, False),
        ("0 2", 1e4, 1.9, True),
        ("0 2", 1e4, 2.1, False),
        ("1 0", 1.1, 1e4, False),
        ("1 0", 0.9, 1e4, True),
    ],
)
def test_a_plane_ends_where_its_size_says(size: str, x: float, y: float, hit: bool) -> None:
    world = loaded(f'<worldbody><geom type="plane" size="{size} 1"/></worldbody>')
    check(world, ((x, y, 2), (0, 0, -1)), 2.0 if hit else INF, 0 if hit else -1)


@pytest.mark.parametrize("gap", [0.0, 1e-7])
def test_the_lower_id_wins_a_tie(gap: float) -> None:
    """The left sides of the two boxes are in one plane; with a gap of 1e-7 m only in float32."""
    geoms = f'<geom type="box" size="1 1 1"/><geom type="box" size="2 1 1" pos="{1 + gap} 0 0"/>'
    world = loaded(f"<worldbody>{geoms}</worldbody>")
    check(world, ((-4, 0.1, 0.2), (1, 0, 0)), 3.0, 0)


@pytest.mark.parametrize("order", ["lower", "higher"])
def test_an_exact_tie_of_unlike_geoms_goes_to_the_lower_id(order: str) -> None:
    geoms = ['<geom type="box" size="1 1 1"/>', '<geom type="mesh" mesh="cube"/>']
    world = loaded(f"{ASSETS}<worldbody>{''.join(geoms if order == 'lower' else geoms[::-1])}</worldbody>")
    check(world, ((-4, 0.125, 0.25), (1, 0, 0)), 3.0, 0)


def test_max_distance_includes_its_own_end() -> None:
    _, _, scene = loaded('<worldbody><geom type="box" size="1 1 1"/></worldbody>')
    at, below = np.float32(3), np.nextafter(np.float32(3), np.float32(0))
    assert scene.cast((-4, 0, 0), [(1, 0, 0)], max_distance=float(at)).numpy().distance[0] == 3
    assert np.isposinf(scene.cast((-4, 0, 0), [(1, 0, 0)], max_distance=float(below)).numpy().distance[0])
    assert scene.cast((-4, 0, 0), [(9, 0, 0)], max_distance=3.0).numpy().distance[0] == 3


@pytest.mark.parametrize(
    ("origins", "directions", "shape"),
    [
        ((-4, 0, 0), (1, 0, 0), ()),
        ((-4, 0, 0), [(1, 0, 0)] * 3, (3,)),
        ([(-4, 0, 0)] * 3, [(1, 0, 0)] * 3, (3,)),
        ((-4, 0, 0), np.broadcast_to((1.0, 0, 0), (2, 3, 3)), (2, 3)),
        (np.broadcast_to((-4.0, 0, 0), (2, 3, 3)), np.broadcast_to((1, 0, 0), (2, 3, 3)), (2, 3)),
        (
            np.array((-4, 0, 0), np.float32),
            np.broadcast_to(np.array((1, 0, 0), np.float32), (4, 1, 2, 3)),
            (4, 1, 2),
        ),
        (np.zeros(3), np.zeros((0, 3)), (0,)),
        (np.zeros(3), np.zeros((5, 0, 3)), (5, 0)),
    ],
)
def test_hits_have_the_shape_of_the_directions(
    origins: npt.ArrayLike, directions: npt.ArrayLike, shape: tuple[int, ...]
) -> None:
    _, _, scene = loaded('<worldbody><geom type="box" size="1 1 1"/></worldbody>')
    hits = scene.cast(origins, directions).numpy()
    assert hits.distance.shape == hits.geom_id.shape == hits.face.shape == shape
    assert hits.normal.shape == (*shape, 3)
    dtypes = [str(part.dtype) for part in (hits.distance, hits.normal, hits.geom_id, hits.face)]
    assert dtypes == ["float32", "float32", "int32", "int32"]
    assert (hits.distance == 3).all()
    assert (hits.normal == (-1, 0, 0)).all()


def test_each_ray_keeps_its_own_origin_and_place() -> None:
    model, data, scene = loaded(SHAPES)
    rng = np.random.default_rng(5)
    origins, directions = rng.uniform(-1, 3, (4, 7, 5, 3)), rng.normal(size=(4, 7, 5, 3))
    hits = scene.cast(origins, directions).numpy()
    assert_none_wrong(model, data, origins, directions, hits)


@pytest.mark.parametrize("kind", ["mesh", "hfield", "box"])
def test_a_face_is_a_triangle_of_a_mesh_or_hfield(kind: str) -> None:
    model, _, scene = loaded(f"{ASSETS}<worldbody>{SOLID[kind][0]}</worldbody>")
    hits = scene.cast((-4, 0.1, RAY_HEIGHT.get(kind, 0.2)), [(1, 0, 0), (-1, 0, 0)]).numpy()
    assert hits.face[1] == -1
    if kind == "mesh":
        corners = model.mesh_vert[model.mesh_face[hits.face[0]]]
        np.testing.assert_allclose(corners[:, 0], -1, atol=1e-6)
    assert (hits.face[0] >= 0) == (kind != "box")
