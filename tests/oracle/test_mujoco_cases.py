"""The rays of MuJoCo's own tests (engine_ray_test.cc) and of mujoco_warp's (ray_test.py), on their own models.

Every ray is compared with mj_ray. Tables also give the distances that are easy to compute, else None.
"""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
from judged_casts import Placed, assert_none_wrong, placed

from rigcast import Filter, oracle

Vector = tuple[float, float, float]
INF = float("inf")


def assert_as_mj_ray(
    world: Placed, origins: npt.ArrayLike, directions: npt.ArrayLike, filter: Filter | None = None
) -> oracle.Comparison:
    model, data, scene = world
    hits = scene.cast(origins, directions, filter=filter).numpy()
    return assert_none_wrong(model, data, origins, directions, hits, filter)


# ---- mujoco_warp: test_data/ray.xml


@pytest.fixture(scope="module")
def shapes() -> Placed:
    found = importlib.util.find_spec("mujoco_warp")  # its files only: it is not imported
    if found is None:
        pytest.skip("mujoco-warp, whose test scene this is, is not installed (it needs a newer MuJoCo)")
    path = Path(str(found.origin)).parent / "test_data" / "ray.xml"
    return placed(mujoco.MjModel.from_xml_path(str(path)))


@pytest.mark.parametrize(
    ("origin", "direction", "geom_id", "distance"),
    [
        ((12.146, 1.865, 3.895), (0, 0, -1), -1, INF),
        ((2, 1, 3), (0.1, 0.2, -1), 0, 3 * 1.05**0.5),
        ((2, 1, -0.5), (0.1, 0.2, -1), -1, INF),
        ((2, 1, 3), (0.1, 0.2, 1), -1, INF),
        ((0, 0, 1.6), (0.1, 0.2, -1), 1, None),
        ((0.5, 1, 1.6), (0, 0.05, -1), 2, None),
        ((-0.5, 1, 0.05), (0, 0.05, 1), 2, None),
        ((0, 1, 0.75), (1, 0, 0), 2, None),
        ((1, 0, 1.6), (0, 0.05, -1), 3, None),
        ((1, 0, 0.05), (0, 0.05, 1), 3, None),
        ((1, 0.4, 0.05), (0, 0, 1), -1, INF),
        ((1, -0.4, 0.05), (0, 0, 1), -1, INF),
        ((1, 0.4, 1.6), (0, 0, -1), 0, 1.6),
        ((2, 2, 2), (-1, -1, -1), 4, None),
        ((4, 2, 2), (-2, -1, -1), 5, None),
        ((4, 2, 2), (2, 1, 1), -1, INF),
        ((0, 2, 2), (0, 0, -1), 6, None),
        ((0.2, 2, 2), (0, 0, -1), 6, None),
        ((-0.2, 2, 2), (0, 0, -1), 6, None),
        ((0, 2.2, 2), (0, 0, -1), 6, None),
        ((0, 1.8, 2), (0, 0, -1), 6, None),
        ((2, 0, 0.05), (0, 0.05, 1), 7, None),
    ],
    ids=str,
)
def test_mujoco_warps_rays(
    shapes: Placed,
    origin: Vector,
    direction: Vector,
    geom_id: int,
    distance: float | None,
) -> None:
    found = assert_as_mj_ray(shapes, origin, [direction])
    assert found.got.geom_id[0] == geom_id
    if distance is not None:
        assert found.got.distance[0] == pytest.approx(distance, rel=1e-6)


@pytest.mark.parametrize(
    "filter", [Filter(geom_groups=()), Filter(static=False), Filter(exclude_bodies=("world",))], ids=str
)
def test_mujoco_warps_filters_leave_nothing(shapes: Placed, filter: Filter) -> None:
    found = assert_as_mj_ray(shapes, (2, 1, 3), [(0.1, 0.2, -1)], filter)
    assert np.isposinf(found.got.distance[0])


# ---- MuJoCo: engine_ray_test.cc

SPHERES = """<mujoco><worldbody>
  <geom name="static_group1" type="sphere" size=".1" pos="1 0 0" group="1"/>
  <body>
    <body><geom name="group0" type="sphere" size=".1" pos="3 0 0"/></body>
    <geom name="group2" type="sphere" size=".1" pos="5 0 0" group="2"/>
  </body>
</worldbody></mujoco>"""


def test_the_fan_of_mujocos_multi_ray_test() -> None:
    """80 x 60 rays from (1, 2, 3) at three spheres on bodies without joints, so that all of it is static."""
    x, z = np.meshgrid(np.linspace(-2, 5, 80), np.linspace(-0.2, 0.2, 60), indexing="ij")
    directions = np.stack([x, np.full_like(x, -2.0), z - 3], axis=-1)
    world = placed(mujoco.MjModel.from_xml_string(SPHERES))
    found = assert_as_mj_ray(world, (1, 2, 3), directions)
    assert (found.got.geom_id >= 0).sum() > 5
    assert (assert_as_mj_ray(world, (1, 2, 3), directions, Filter(static=False)).got.geom_id < 0).all()


# A cube of 2 cm with its edges and corners cut at 1.5 mm
CUBELET = [
    (s0 * a, s1 * b, s2 * c)
    for a, b, c in ((0.0085, 0.01, 0.0085), (0.01, 0.0085, 0.0085), (0.0085, 0.0085, 0.01))
    for s0 in (-1, 1)
    for s1 in (-1, 1)
    for s2 in (-1, 1)
]


def test_the_fan_of_mujocos_mesh_test() -> None:
    """Rays from 0.2 m away at a mesh of 2 cm with edges of 1.5 mm cut off, of lengths from 1e-3 to 1e3."""
    vertices = " ".join(f"{x:g}" for vertex in CUBELET for x in vertex)
    world = placed(
        mujoco.MjModel.from_xml_string(
            f'<mujoco><asset><mesh name="cubelet" vertex="{vertices}"/></asset>'
            '<worldbody><body pos="1 0 0"><geom type="mesh" mesh="cubelet"/></body></worldbody></mujoco>'
        )
    )
    rng = np.random.default_rng(0)
    directions = rng.uniform(-0.012, 0.012, (4800, 3)) - [0.0, 0.2, 0.0]
    origins = np.array([1.0, 0.2, 0.0])
    lengths = 10.0 ** rng.uniform(-3, 3, (4800, 1))
    found = assert_as_mj_ray(world, origins, directions * lengths)
    assert 0.5 < (found.got.geom_id == 0).mean() < 1
