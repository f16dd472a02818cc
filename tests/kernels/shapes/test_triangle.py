"""One ray against one triangle, with known answers: the reference form step by step, and the cast's forms."""

from collections.abc import Callable, Iterator

import launchers
import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE

EPS = 2.0**-23
INF = np.inf
V0, V1, V2 = (0, 0, 0), (4, 0, 0), (0, 4, 0)  # the normal is +z
UP = (0, 0, 1)

Point = tuple[float, float, float]
Form = Callable[..., NDArray[np.floating]]


# ---- the reference form, step by step


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        ((V0, V1, V2), (0, 0, 16)),
        ((V1, V2, V0), (0, 0, 16)),
        ((V2, V0, V1), (0, 0, 16)),
        ((V0, V2, V1), (0, 0, -16)),
        (((0, 0, 0), (0, 2, 0), (0, 0, 3)), (6, 0, 0)),
        (((0, 0, 0), (0, 0, 2), (3, 0, 0)), (0, 6, 0)),
        (((5, 5, 5), (5, 5, 5), (1, 2, 3)), (0, 0, 0)),
        (((1, 1, 1), (2, 2, 2), (4, 4, 4)), (0, 0, 0)),
    ],
)
def test_normal_is_twice_the_area_on_the_side_seen_counter_clockwise(
    corners: tuple[Point, Point, Point], expected: Point
) -> None:
    np.testing.assert_array_equal(launchers.normal(*corners)[0], expected)


@pytest.mark.parametrize(
    ("origin", "direction", "parallel", "expected"),
    [
        ((1, 1, 5), (0, 0, -1), 0, 5),
        ((1, 1, -5), (0, 0, 1), 0, 5),
        ((1, 1, 5), (0, 0, 1), 0, INF),  # behind
        ((1, 1, 0), (0, 0, 1), 0, 0),  # on the plane
        ((0, 0, 3), (0.6, 0, -0.8), 0, 3.75),
        ((0, 0, 3), (1, 0, 0), 0, INF),  # parallel
        ((0, 0, 0), (1, 0, 0), 0, INF),  # in the plane
        ((0, 0, 1), (1, 0, -(2.0**-20)), 0, 2.0**20),  # nearly parallel: kept by a threshold of 0 ...
        ((0, 0, 1), (1, 0, -(2.0**-20)), 2.0**-21, 2.0**20),
        ((0, 0, 1), (1, 0, -(2.0**-20)), 2.0**-20, INF),  # ... and dropped at the threshold
        ((0, 0, 1), (1, 0, 2.0**-20), 2.0**-20, INF),
        ((0, 0, 3), (0.6, 0, -0.8), 0.1, 3.75),
        ((0, 0, 3), (0.6, 0, -0.8), 0.81, INF),
        ((0, 0, 1e4), (0, 0, -1), 0, 1e4),
    ],
)
def test_plane_distance(origin: Point, direction: Point, parallel: float, expected: float) -> None:
    got = launchers.distance_to_plane(origin, direction, V0, UP, parallel)[0]
    assert got == pytest.approx(expected, rel=2 * EPS)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((1, 1, 0), True),
        ((0, 0, 0), True),
        ((4, 0, 0), True),
        ((0, 4, 0), True),
        ((2, 0, 0), True),
        ((2, 2, 0), True),
        ((0, 2, 0), True),
        ((2, -0.001, 0), False),
        ((2.001, 2.001, 0), False),
        ((-0.001, 2, 0), False),
        ((-0.001, -0.001, 0), False),
        ((4.001, 0, 0), False),
        ((0, 4.001, 0), False),
    ],
)
def test_inside_includes_the_border_whatever_the_winding(point: Point, expected: bool) -> None:
    corners = np.array([V0, V1, V2])
    for turn in range(3):
        a, b, c = np.roll(corners, turn, axis=0)
        assert launchers.is_inside(point, a, b, c, UP)[0] == expected
        assert launchers.is_inside(point, a, c, b, (0, 0, -1))[0] == expected


# ---- all forms

FORMS = {"reference": launchers.reference, "float64": launchers.decide, "cast": launchers.intersect}


def forms(*names: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("form", [FORMS[name] for name in names], ids=names)


def in_every_order() -> Iterator[NDArray[np.int64]]:
    """The corners in both windings, each beginning with any of them."""
    for turn in range(3):
        a, b, c = np.roll([V0, V1, V2], turn, axis=0)
        yield np.array([a, b, c])
        yield np.array([a, c, b])


@forms("reference")  # in the cast, a ray aimed at the border may miss a triangle without neighbours
@pytest.mark.parametrize(("x", "y"), [(0, 0), (4, 0), (0, 4), (2, 0), (2, 2), (0, 2), (1, 3), (3, 1)])
def test_border_is_part_of_the_triangle(form: Form, x: float, y: float) -> None:
    for corners in in_every_order():
        assert form((x, y, 2), (0, 0, -1), *corners)[0] == 2
        assert form((x, y, -2), (0, 0, 1), *corners)[0] == 2


@forms("reference", "float64", "cast")
@pytest.mark.parametrize("off", [1e-5, 1e-3, 0.5])
@pytest.mark.parametrize(
    ("x", "y", "out_x", "out_y"),
    [(2, 0, 0, -1), (2, 2, 1, 1), (0, 2, -1, 0), (0, 0, -1, -1), (4, 0, 2, -1), (0, 4, -1, 2)],
    ids=["edge 0", "edge 1", "edge 2", "vertex 0", "vertex 1", "vertex 2"],
)
def test_miss_off_and_hit_within_each_edge_and_vertex(
    form: Form, x: float, y: float, out_x: float, out_y: float, off: float
) -> None:
    for corners in in_every_order():
        for z in (2, -2):
            assert form((x + off * out_x, y + off * out_y, z), (0, 0, -z / 2), *corners)[0] == INF
            assert form((x - off * out_x, y - off * out_y, z), (0, 0, -z / 2), *corners)[0] == pytest.approx(
                2, rel=2e-9
            )


@forms("reference", "float64", "cast")
@pytest.mark.parametrize(
    ("side", "cull", "is_hit"),
    [
        ("above", CULL_NONE, True),
        ("above", CULL_BACK, True),
        ("above", CULL_FRONT, False),
        ("below", CULL_NONE, True),
        ("below", CULL_BACK, False),
        ("below", CULL_FRONT, True),
    ],
)
def test_cull(form: Form, side: str, cull: int, is_hit: bool) -> None:
    z = 3.0 if side == "above" else -3.0
    expected = 3.0 if is_hit else INF
    assert form((1, 1, z), (0, 0, -z / 3), V0, V1, V2, cull=cull)[0] == expected
    assert form((1, 1, -z), (0, 0, z / 3), V0, V2, V1, cull=cull)[0] == expected, "other winding"


@forms("reference", "float64", "cast")
@pytest.mark.parametrize(
    ("name", "origin", "direction", "expected", "tolerance"),
    [
        ("behind", (1, 1, 2), (0, 0, 1), INF, 0),
        ("behind, from below", (1, 1, -2), (0, 0, -1), INF, 0),
        ("origin on it", (1, 1, 0), (0, 0, 1), 0, 0),
        ("origin on an edge", (2, 0, 0), (0, 0, 1), 0, 0),
        ("origin on a vertex", (4, 0, 0), (0, 0, -1), 0, 0),
        ("parallel", (1, 1, 1), (1, 0, 0), INF, 0),
        ("in its plane", (-1, 1, 0), (1, 0, 0), INF, 0),
        ("slanted", (1 - 0.6 * 5, 1, 0.8 * 5), (0.6, 0, -0.8), 5, 5 * EPS),
        # |t - t_ref| <= 2.5 eps (|V - O| + t) / |cos|
        ("grazing, 1e-3", (1 - 10, 1, 0.01), (1, 0, -1e-3), 10, 2.5 * EPS * 23 / 1e-3),
        ("grazing, 1e-5", (1 - 10, 1, 1e-4), (1, 0, -1e-5), 10, 2.5 * EPS * 23 / 1e-5),
        ("grazing, past it", (-100, 1, 1e-3), (1, 0, -1e-3), INF, 0),
        ("far above", (1, 1, 1e4), (0, 0, -1), 1e4, 0),
        ("far above, beside it", (1, -0.1, 1e4), (0, 0, -1), INF, 0),
        ("far aside", (1 - 8e3, 1, 6e3), (0.8, 0, -0.6), 1e4, 2.5 * EPS * 2e4 / 0.6),
    ],
)
def test_known_answers(
    form: Form, name: str, origin: Point, direction: Point, expected: float, tolerance: float
) -> None:
    got = form(origin, direction, V0, V1, V2)[0]
    assert got == expected or abs(got - expected) <= tolerance, f"{name}: got {got}, expected {expected}"


P, Q = np.array([1.0, 2.0, -3.0]), np.array([0.3, -0.7, 2.1])


@forms("reference", "float64", "cast")
@pytest.mark.parametrize(
    ("name", "corners"),
    [
        ("first two equal", (P, P, Q)),
        ("last two equal", (P, Q, Q)),
        ("ends equal", (P, Q, P)),
        ("all equal", (P, P, P)),
        ("all zero, an absent lane", (0 * P, 0 * P, 0 * P)),
        ("on a line", (0 * P, P, 2 * P)),
        ("on a line, the middle first", (P, 0 * P, 2 * P)),
        ("on a line along an axis", ((1.0, 1, 1), (3.0, 1, 1), (2.0, 1, 1))),
    ],
)
def test_degenerate_triangle_is_never_hit(form: Form, name: str, corners: tuple[NDArray[np.float64], ...]) -> None:
    rng = np.random.default_rng(0)
    a, b, c = np.array(corners, np.float32)
    weights = rng.dirichlet((1, 1, 1), 2000)
    weights[:300] = np.eye(3)[rng.integers(0, 3, 300)]
    target = weights @ np.stack([a, b, c]).astype(np.float64)
    origin = np.where(rng.random((2000, 1)) < 0.1, target, rng.uniform(-5, 5, (2000, 3))).astype(np.float32)
    direction = target - origin
    direction[np.linalg.norm(direction, axis=1) == 0] = (1, 0, 0)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    direction[:100] = np.eye(3)[rng.integers(0, 3, 100)]
    got = form(origin, direction, a, b, c)
    assert (got == INF).all(), f"{name}: got {got[got != INF][:5]}"


@forms("reference", "cast")
def test_ray_of_nan_never_hits(form: Form) -> None:
    for k in range(3):
        nan = np.where(np.arange(3) == k, np.nan, 0)
        assert form(np.array((1, 1, 2)) + nan, (0, 0, -1), V0, V1, V2)[0] == INF
        assert form((1, 1, 2), np.array((0, 0, -1)) + nan, V0, V1, V2)[0] == INF


def test_absent_triangle_is_a_sure_miss() -> None:
    """The empty lanes of a block are NaN."""
    nan = (np.nan, np.nan, np.nan)
    directions = np.random.default_rng(0).normal(size=(1000, 3))
    assert (launchers.triage((1, 1, 2), directions, nan, nan, nan) == INF).all()


@pytest.mark.parametrize(
    ("name", "origin", "direction", "expected"),
    [
        ("the middle", (1, 1, 2), (0, 0, -1), 2),
        ("beside it", (-1, 1, 2), (0, 0, -1), INF),
        ("behind", (1, 1, 2), (0, 0, 1), INF),
        ("an edge", (2, 0, 2), (0, 0, -1), launchers.UNDECIDED),
        ("a vertex", (4, 0, 2), (0, 0, -1), launchers.UNDECIDED),
        ("close to an edge", (1e-7, 2, 2), (0, 0, -1), launchers.UNDECIDED),
        ("not so close to an edge", (1e-4, 2, 2), (0, 0, -1), 2),
        ("edge-on", (-1, 1, 0), (1, 0, 0), launchers.UNDECIDED),
        ("nearly edge-on", (1 - 10, 1, 0.1), (1, 0, -0.01), launchers.UNDECIDED),
        ("the origin on it", (1, 1, 0), (0, 0, -1), launchers.UNDECIDED),
    ],
)
def test_float32_decides_unless_rounding_could_matter(
    name: str, origin: Point, direction: Point, expected: float
) -> None:
    got = launchers.triage(origin, direction, V0, V1, V2)[0]
    assert got == pytest.approx(expected, rel=1e-6), f"{name}: got {got}, expected {expected}"
