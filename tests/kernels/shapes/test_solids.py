"""Closed-form solids and planes: known answers, and random rays against a search along the ray in float64.

The search shares nothing with the kernels: along a line, the distance to a convex solid is a convex function, so its
least value is found by narrowing an interval, and the surface on either side of it by halving.
"""

from collections.abc import Callable

import launchers
import numpy as np
import pytest
from made_worlds import KINDS, NAME, Doubles, unit
from moeller_trumbore import dot, norm

from rigcast.kernels.shapes.solids import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE, SPHERE
from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE

EPS = 2.0**-23
INF = np.inf
SEED = 3
RAYS = 20_000
SOLIDS = [kind for kind in KINDS if kind != PLANE]
by_name = pytest.mark.parametrize("kind", SOLIDS, ids=lambda kind: NAME[kind])

Point = tuple[float, float, float]
UNIT = (1.0, 1.0, 1.0)  # radius or half sizes 1; capsules reach z = +-2
TOP = {SPHERE: 1.0, CAPSULE: 2.0, ELLIPSOID: 1.0, CYLINDER: 1.0, BOX: 1.0}


# ---- known answers


@by_name
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_along_an_axis_through_the_middle(kind: int, axis: int, sign: int) -> None:
    """Directions with two zero components, of either sign."""
    d = sign * np.eye(3)[axis]
    d[np.arange(3) != axis] *= -1  # -0.0
    near = TOP[kind] if axis == 2 else 1.0
    for origin, none, back, front in (
        (-5 * d, 5 - near, 5 - near, 5 + near),  # outside
        (-near * d, 0, 0, 2 * near),  # on the surface, looking in
        (0 * d, near, INF, near),  # inside
        (near * d, 0, INF, 0),  # on the surface, looking out
        (5 * d, INF, INF, INF),  # behind
    ):
        for cull, expected in ((CULL_NONE, none), (CULL_BACK, back), (CULL_FRONT, front)):
            got = launchers.closed_form(kind, UNIT, origin, d, cull)[0]
            assert got == expected, f"origin {origin}, cull {cull}: got {got}, expected {expected}"


@pytest.mark.parametrize(
    ("kind", "size", "origin", "direction", "expected"),
    [
        # touches count, and so does an origin on the surface
        (SPHERE, (1, 0, 0), (-3, 1, 0), (1, 0, 0), 3),
        (SPHERE, (1, 0, 0), (-3, 1.0001, 0), (1, 0, 0), INF),
        (SPHERE, (1, 0, 0), (0, 1, 0), (1, 0, 0), 0),
        (SPHERE, (0.1, 0, 0), (-0.5, 0, 0), (-1, 0, 0), INF),
        (ELLIPSOID, (2, 1, 3), (-3, 1, 0), (1, 0, 0), 3),
        (ELLIPSOID, (2, 1, 3), (-3, 1.0001, 0), (1, 0, 0), INF),
        (ELLIPSOID, (2, 1, 3), (-5, 0, 0), (1, 0, 0), 3),
        (ELLIPSOID, (2, 1, 3), (0, 0, 7), (0, 0, -1), 4),
        (CYLINDER, (1, 2, 0), (-3, 1, 0), (1, 0, 0), 3),
        (CYLINDER, (1, 2, 0), (-3, 1.0001, 0), (1, 0, 0), INF),
        (CYLINDER, (1, 2, 0), (-3, 0, 2), (1, 0, 0), 2),  # within the cap
        (CYLINDER, (1, 2, 0), (-3, 0, 2.0001), (1, 0, 0), INF),
        (CYLINDER, (1, 2, 0), (1, 0, 5), (0, 0, -1), 3),  # down the side
        (CYLINDER, (1, 2, 0), (1.0001, 0, 5), (0, 0, -1), INF),
        (CYLINDER, (1, 2, 0), (1, 0, 0), (0, 0, 1), 2),
        (CYLINDER, (1, 2, 0), (0.5, 0, 2), (1, 0, 0), 0.5),  # on the cap, along it: where it leaves
        (CYLINDER, (1, 2, 0), (0.5, 0, 2), (0, 0, 1), 0),
        (CYLINDER, (1, 2, 0), (-2, 0, 4), (0.6, 0, -0.8), 2.5),  # into the cap
        (CYLINDER, (1, 2, 0), (-4, 0, 4), (0.6, 0, -0.8), 5),  # into the side
        (CYLINDER, (1, 2, 0), (-8, 0, 4), (0.6, 0, -0.8), INF),  # below it
        (CAPSULE, (1, 2, 0), (-3, 0, 2.5), (1, 0, 0), 3 - np.sqrt(0.75)),
        (CAPSULE, (1, 2, 0), (-3, 0, 3), (1, 0, 0), 3),
        (CAPSULE, (1, 2, 0), (-3, 0, 3.0001), (1, 0, 0), INF),
        (CAPSULE, (1, 2, 0), (-3, 1, 1), (1, 0, 0), 3),
        (CAPSULE, (1, 2, 0), (0, 0, 0), (0, 0, 1), 3),
        (CAPSULE, (1, 2, 0), (0.5, 0, 0), (0, 0, -1), 2 + np.sqrt(0.75)),
        (CAPSULE, (1, 2, 0), (0, 0, 2.5), (1, 0, 0), np.sqrt(0.75)),  # inside an end
        (CAPSULE, (0.05, 0.4, 0), (0, 0, 100), (0, 0, -1), 99.55),
        (BOX, (1, 2, 3), (-5, 2, 0), (1, 0, 0), 4),  # within a face
        (BOX, (1, 2, 3), (-5, 2, 3), (1, 0, 0), 4),  # along an edge
        (BOX, (1, 2, 3), (-5, 2.0001, 0), (1, 0, 0), INF),
        (BOX, (1, 2, 3), (1, 0, 0), (0, 1, 0), 2),  # on a face, along it
        (BOX, (1, 2, 3), (1, 2, 3), (0, 0, 1), 0),  # on a vertex
        (BOX, (1, 2, 3), (0, 0, 0), (0.6, 0.8, 0), 1 / 0.6),
        (BOX, (1, 2, 3), (-4, 6, 0), (0.6, -0.8, 0), 5),
    ],
)
def test_known_answers(kind: int, size: Point, origin: Point, direction: Point, expected: float) -> None:
    got = launchers.closed_form(kind, size, origin, direction)[0]
    assert got == pytest.approx(expected, rel=4 * EPS), f"{NAME[kind]} {size}"


@pytest.mark.parametrize(
    ("size", "origin", "direction", "expected"),
    [
        ((0, 0, 0), (1, 2, 3), (0, 0, -1), 3),
        ((0, 0, 0), (1, 2, 3), (0.6, 0, -0.8), 3.75),
        ((0, 0, 0), (1, 2, -3), (0, 0, 1), INF),  # from below
        ((0, 0, 0), (1, 2, -3), (0, 0, -1), INF),
        ((0, 0, 0), (1, 2, 3), (0, 0, 1), INF),  # looking away
        ((0, 0, 0), (1, 2, 3), (1, 0, 0), INF),  # parallel
        ((0, 0, 0), (1, 2, 0), (1, 0, 0), INF),
        ((0, 0, 0), (1, 2, 0), (0, 0, -1), 0),  # on it
        ((0, 0, 0), (1, 2, 0), (0, 0, 1), INF),
        ((0, 0, 0), (1e6, -1e6, 1e5), (0, 0, -1), 1e5),
        ((0, 0, 0), (0, 0, 1), (1, 0, -1e-5), 1e5),
        ((1, 2, 0), (1, 2, 3), (0, 0, -1), 3),  # its corner
        ((1, 2, 0), (1.001, 0, 3), (0, 0, -1), INF),
        ((1, 2, 0), (0, -2.001, 3), (0, 0, -1), INF),
        ((1, 2, 0), (-3, 0, 3), (0.8, 0, -0.6), 5),
        ((1, 2, 0), (-6, 0, 3), (0.8, 0, -0.6), INF),
        ((1, 0, 0), (1, 1e5, 3), (0, 0, -1), 3),  # a strip without end
        ((1, 0, 0), (1.001, 0, 3), (0, 0, -1), INF),
        ((0, 2, 0), (1e5, 2, 3), (0, 0, -1), 3),
        ((0, 2, 0), (0, 2.001, 3), (0, 0, -1), INF),
    ],
)
def test_plane_has_one_side_and_ends_only_where_it_has_a_size(
    size: Point, origin: Point, direction: Point, expected: float
) -> None:
    for cull in (CULL_NONE, CULL_BACK):
        assert launchers.closed_form(PLANE, size, origin, direction, cull)[0] == pytest.approx(expected, rel=4 * EPS)
    assert launchers.closed_form(PLANE, size, origin, direction, CULL_FRONT)[0] == INF


# ---- against a search in float64


def implicit(kind: int, size: Doubles, p: Doubles) -> Doubles:
    """A convex function (n,) of p, below 0 inside: a signed distance, for an ellipsoid in units of its radii."""
    x, y, z = np.moveaxis(p, -1, 0)
    if kind == SPHERE:
        return norm(p) - size[..., 0]
    if kind == ELLIPSOID:
        return norm(p / size) - 1
    if kind == CYLINDER:
        return np.maximum(np.hypot(x, y) - size[..., 0], np.abs(z) - size[..., 1])
    if kind == CAPSULE:
        beyond = np.maximum(np.abs(z) - size[..., 1], 0)
        return np.sqrt(x * x + y * y + beyond * beyond) - size[..., 0]
    return np.max(np.abs(p) - size, axis=-1)


def least(f: Callable[[Doubles], Doubles], low: Doubles, high: Doubles) -> Doubles:
    """The minimum's place of a convex function, by ternary search."""
    for _ in range(150):
        third = (high - low) / 3
        is_left = f(low + third) < f(high - third)
        low, high = np.where(is_left, low, low + third), np.where(is_left, high - third, high)
    return (low + high) / 2


def root(f: Callable[[Doubles], Doubles], inside: Doubles, outside: Doubles) -> Doubles:
    """The place where f changes its sign, by bisection."""
    for _ in range(80):
        middle = (inside + outside) / 2
        is_inside = f(middle) <= 0
        inside, outside = np.where(is_inside, middle, inside), np.where(is_inside, outside, middle)
    return (inside + outside) / 2


def random_rays(rng: np.random.Generator) -> tuple[Doubles, Doubles, Doubles]:
    """Sizes of 1 cm to 10 m, origins inside to 100 m away, most rays towards the solid, one in eight along an axis."""
    size = 10 ** rng.uniform(-2, 1, (RAYS, 3))
    near = rng.uniform(-2, 2, (RAYS, 3)) * size.max(axis=1)[:, None]
    far = 10 ** rng.uniform(-2, 2, (RAYS, 1)) * unit(rng.normal(size=(RAYS, 3)))
    origin = np.where(rng.random((RAYS, 1)) < 0.5, near, far)
    target = rng.uniform(-1, 1, (RAYS, 3)) * np.stack([size[:, 0], size[:, 0], size[:, 1]], axis=-1)
    direction = unit(target - origin)
    along = np.arange(RAYS) % 8 == 0
    axis = rng.integers(0, 3, RAYS)
    direction[along] = np.copysign(np.eye(3)[axis], direction)[along]
    back = np.where(axis == np.arange(3)[:, None], far[:, :1].T, 0).T
    origin[along] = (target - direction * np.abs(back))[along]
    rays = (a.astype(np.float32).astype(np.float64) for a in (size, origin, direction))
    size, origin, direction = rays
    return size, origin, direction


@by_name
@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT], ids=["none", "back", "front"])
def test_hits_are_those_of_a_search_along_the_ray(kind: int, cull: int) -> None:
    """The hit is on the surface, to 8 eps (|o| + size), on the right side; hit and miss are swapped only within that.

    8 eps = 16u: l = o - (o . d) d has 6u |o|, c and the roots of the quadratic another 6u, |d| is 1 to 2u.
    """
    size, o, d = random_rays(np.random.default_rng(SEED))
    t = launchers.closed_form(kind, size, o, d, cull).astype(np.float64)
    scale = 1.0 / size if kind == ELLIPSOID else np.ones((RAYS, 3))
    extent = 1.0 if kind == ELLIPSOID else norm(size[:, :2] if kind != BOX else size)
    bound = 8 * EPS * (norm(o * scale) + extent)

    def f(at: Doubles) -> Doubles:
        return implicit(kind, size, o + at[:, None] * d)

    reach = norm(o) + 4 * norm(size)
    lowest = least(f, -reach, reach)
    enter, leave = root(f, lowest, -reach), root(f, lowest, reach)
    depth = f(lowest)
    is_crossed = depth < 0
    expected = np.where(is_crossed & (leave >= 0) & (cull != CULL_BACK), leave, INF)
    expected = np.where(is_crossed & (enter >= 0) & (cull != CULL_FRONT), enter, expected)

    is_clear = (np.abs(depth) > bound) & (np.abs(f(np.zeros(RAYS))) > bound)  # no touch, no origin on the surface
    wrong = is_clear & ((t < INF) != (expected < INF))
    assert not wrong.any(), f"seed {SEED}: ray {np.flatnonzero(wrong)[0]} of {wrong.sum()}"
    hit = t < INF
    ratio = np.where(hit, np.abs(f(np.where(hit, t, 0))) / bound, 0)
    assert ratio.max() <= 1, f"seed {SEED}: ray {ratio.argmax()} is {ratio.max():.3g} times the bound off the surface"
    is_entry = expected == enter
    wrong_side = is_clear & hit & (np.where(hit, t, 0) < lowest) != (is_clear & hit & is_entry)
    wrong_side &= np.abs(enter - leave) > 1e-3 * (reach - norm(size))
    assert not wrong_side.any(), f"seed {SEED}: ray {np.flatnonzero(wrong_side)[0]} has the other crossing"
    assert hit.mean() > 0.2
    assert (is_clear & ~hit).mean() > 0.04


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: NAME[kind])
@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT], ids=["none", "back", "front"])
def test_the_interval_of_float32_holds_the_distance_of_float64(kind: int, cull: int) -> None:
    """It leaves open only few rays: those that touch, graze, or meet a crease."""
    size, o, d = random_rays(np.random.default_rng(SEED + 2))
    t, near, far = launchers.closed_form_looks(kind, size, o, d, cull).T
    outside = ~((near <= t) & (t <= far))
    assert not outside.any(), f"seed {SEED + 2}: ray {np.flatnonzero(outside)[0]} of {outside.sum()}"
    assert ((near < INF) & (far == INF)).mean() < 0.01
    assert np.isfinite(t).mean() > 0.1 or (kind, cull) == (PLANE, CULL_FRONT)


@pytest.mark.parametrize(
    ("kind", "size", "origin", "direction"),
    [
        (SPHERE, (1, 0, 0), (-3, 1, 0), (1, 0, 0)),  # a touch
        (SPHERE, (1, 0, 0), (0, 1, 0), (1, 0, 0)),  # from the surface
        (SPHERE, (1e-3, 0, 0), (1e4, 0, 0), (-1, 0, 0)),  # too small to be seen from there in float32
        (CYLINDER, (1, 2, 0), (1, 0, 5), (0, 0, -1)),  # down the side
        (CYLINDER, (1, 2, 0), (-3, 0, 2), (1, 0, 0)),  # within the cap
        (CAPSULE, (1, 2, 0), (-3, 1, 1), (1, 0, 0)),
        (BOX, (1, 2, 3), (-5, 2, 0), (1, 0, 0)),  # within a face
        (BOX, (1, 2, 3), (-5, 2, 0), (1, -1e-8, 0)),  # nearly so
        (PLANE, (1, 2, 0), (1, 0, 3), (0, 0, -1)),  # at its edge
    ],
)
def test_what_float32_cannot_tell_is_left_open(kind: int, size: Point, origin: Point, direction: Point) -> None:
    t, near, far = launchers.closed_form_looks(kind, size, origin, direction)[0]
    assert (near, far) == (0, INF)
    assert t < INF


@pytest.mark.parametrize("distance", [1.0, 10.0, 50.0, 100.0, 1e3])
@pytest.mark.parametrize("kind", [SPHERE, CAPSULE, ELLIPSOID], ids=lambda kind: NAME[kind])
def test_small_and_far_round_solids(kind: int, distance: float) -> None:
    """Radius 5 cm: |t - t_ref| <= 1e-5 (1 + t) / |cos|, where the textbook formula loses most of these rays."""
    radius = float(np.float32(0.05))
    rng = np.random.default_rng(SEED)
    o = (distance * unit(rng.normal(size=(5000, 3)))).astype(np.float32).astype(np.float64)
    aside = unit(np.cross(o, rng.normal(size=(5000, 3)))) * radius * np.sqrt(rng.uniform(0, 0.98, (5000, 1)))
    d = unit(aside - o).astype(np.float32).astype(np.float64)
    size = {SPHERE: (radius, 0, 0), CAPSULE: (radius, 1e-9, 0), ELLIPSOID: (radius, radius, radius)}[kind]
    t = launchers.closed_form(kind, size, o, d)
    # float64: t^2 d . d + 2 t o . d + o . o - r^2 = 0
    a, b, c = dot(d, d), dot(o, d), dot(o, o) - radius**2
    expected = (-b - np.sqrt(b * b - a * c)) / a
    cosine = np.abs(dot(unit(o + expected[:, None] * d), d))
    ratio = np.abs(t - expected) / (1e-5 * (1 + expected) / np.maximum(cosine, 1e-3))
    # 16u (|o| + r) is how far a ray may be misplaced: at 1 km as much as a fifth of these graze
    sure = (1 - dot(aside, aside) / radius**2) * radius / 2 > 8 * EPS * (distance + radius)
    assert sure.mean() > 0.8
    assert ratio[sure].max() <= 1, f"seed {SEED}: ray {ratio.argmax()}: {ratio.max():.3g} times the bound"


# ---- normals


@pytest.mark.parametrize(
    ("kind", "size", "point", "expected"),
    [
        (PLANE, (0, 0, 0), (3, 4, 0), (0, 0, 1)),
        (SPHERE, (5, 0, 0), (3, 0, 4), (0.6, 0, 0.8)),
        (SPHERE, (5, 0, 0), (0, 0, -5), (0, 0, -1)),
        (CAPSULE, (1, 2, 0), (0.6, 0.8, 1), (0.6, 0.8, 0)),
        (CAPSULE, (1, 2, 0), (0.6, 0, 2.8), (0.6, 0, 0.8)),
        (CAPSULE, (1, 2, 0), (0, 0.6, -2.8), (0, 0.6, -0.8)),
        (CYLINDER, (1, 2, 0), (0.6, -0.8, 1), (0.6, -0.8, 0)),
        (CYLINDER, (1, 2, 0), (0.5, 0.5, 2), (0, 0, 1)),
        (CYLINDER, (1, 2, 0), (0.5, 0.5, -2), (0, 0, -1)),
        (BOX, (1, 2, 3), (-1, 1, 1), (-1, 0, 0)),
        (BOX, (1, 2, 3), (0.5, 2, 1), (0, 1, 0)),
        (BOX, (1, 2, 3), (0.5, -1, -3), (0, 0, -1)),
        (ELLIPSOID, (2, 1, 3), (2, 0, 0), (1, 0, 0)),
        (ELLIPSOID, (2, 1, 3), (0, 0, -3), (0, 0, -1)),
        (ELLIPSOID, (1e-3, 1e3, 1), (0, 1e3, 0), (0, 1, 0)),
    ],
)
def test_normal_at_known_points(kind: int, size: Point, point: Point, expected: Point) -> None:
    for aside in (0.0, 0.7):
        direction = unit(-np.array(expected, np.float64) + aside * np.array([0.3, -0.5, 0.4]))
        np.testing.assert_allclose(launchers.normal_at(kind, size, point, direction)[0], expected, atol=2 * EPS)


@pytest.mark.parametrize(
    ("kind", "size", "point", "direction", "distance", "expected"),
    [
        (BOX, (1, 1, 1), (-1, 0, 1), (1, 0, 0), 1, (-1, 0, 0)),
        (BOX, (1, 1, 1), (-1, 0, 1), (1, 0, -1e-8), 1, (-1, 0, 0)),
        (BOX, (1, 1, 1), (-1.0001, 0, 1), (1, 0, 0), 1000, (-1, 0, 0)),  # rounded, so far away
        (BOX, (1, 1, 1), (-1.0001, 0, 1), (1, 0, 0), 1, (0, 0, 1)),
        (BOX, (1, 2, 3), (1, 2, -1), (0, -1, 0), 1, (0, 1, 0)),
        (BOX, (1, 2, 3), (1, 2, -3), (0.1, 0, 1), 1, (0, 0, -1)),
        (CYLINDER, (1, 2, 0), (-1, 0, 2), (1, 0, 0), 1, (-1, 0, 0)),
        (CYLINDER, (1, 2, 0), (-1.0001, 0, 2), (1, 0, 0), 1000, (-1, 0, 0)),
        (CYLINDER, (1, 2, 0), (-1, 0, 2), (0, 0, -1), 1, (0, 0, 1)),
    ],
)
def test_a_ray_within_a_face_hits_the_face_that_it_crosses(
    kind: int, size: Point, point: Point, direction: Point, distance: float, expected: Point
) -> None:
    """The point, on an edge, does not tell which face it is."""
    got = launchers.normal_at(kind, size, point, direction, distance)[0]
    np.testing.assert_allclose(got, expected, atol=2 * EPS)


@by_name
def test_normal_is_the_gradient(kind: int) -> None:
    """By finite differences in float64, at points of the surface that are not on an edge."""
    size, o, d = random_rays(np.random.default_rng(SEED + 1))
    t = launchers.closed_form(kind, size, o, d).astype(np.float64)
    size, p, d = size[t < INF], (o + np.where(t < INF, t, 0)[:, None] * d)[t < INF], d[t < INF]
    got = launchers.normal_at(kind, size, p, d)
    step = 1e-4 * size.min(axis=1)
    slopes = [
        implicit(kind, size, p + step[:, None] * axis) - implicit(kind, size, p - step[:, None] * axis)
        for axis in np.eye(3)
    ]
    slope = np.stack(slopes, axis=-1)
    if kind == ELLIPSOID:
        slope = p / size**2  # too curved for differences
    expected = unit(slope)
    is_smooth = np.ones(len(p), bool)
    if kind in (CYLINDER, BOX):
        is_smooth = np.abs(expected).max(axis=1) > 1 - 1e-9 if kind == BOX else np.abs(expected[:, 2]) % 1 < 1e-9
    error = norm(got - expected)[is_smooth]
    assert error.max() < 2e-3, f"seed {SEED + 1}: {error.max()} at hit {error.argmax()}"
    assert is_smooth.mean() > 0.95
    np.testing.assert_allclose(norm(got.astype(np.float64)), 1, atol=4 * EPS)
