"""Random rays, each against one triangle: both forms against float64 numpy, with derived rounding bounds.

u = eps / 2 = 2^-24 is the error of one rounding. Bounds are to first order in u, times 1.1 for higher orders.
"""

from itertools import permutations
from typing import NamedTuple

import launchers
import numpy as np
import pytest
from moeller_trumbore import Doubles, dot, moeller_trumbore, norm
from numpy.typing import NDArray

from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_NONE

EPS = 2.0**-23
U = EPS / 2
INF = np.inf
PAIRS = 200_000
SEED = 7
ORDERS = list(permutations(range(3)))


class Pairs(NamedTuple):
    """Rays and triangles in float32, and their distances and so on in float64, (n, ...)."""

    origin: launchers.Floats
    direction: launchers.Floats
    corners: launchers.Floats  # (n, 3 vertices, 3)
    t: Doubles
    barycentric: Doubles  # (n, 3), of the vertices
    cosine: Doubles  # |cos| between ray and normal
    height: Doubles  # (n, 3) of the triangle above the edge that is opposite to each vertex

    @property
    def rays(self) -> tuple[launchers.Floats, launchers.Floats, launchers.Floats, launchers.Floats, launchers.Floats]:
        v = self.corners
        return self.origin, self.direction, v[:, 0], v[:, 1], v[:, 2]

    @property
    def vertices(self) -> Doubles:
        """The vertices V - O, (n, 3, 3)."""
        return self.corners.astype(np.float64) - self.origin[:, None]

    @property
    def point(self) -> Doubles:
        """The point P - O, (n, 3)."""
        return self.t[:, None] * self.direction.astype(np.float64)

    @property
    def is_inside(self) -> NDArray[np.bool_]:
        return (self.t > 0) & (self.barycentric > 0).all(axis=1)


def unit(a: Doubles) -> Doubles:
    return a / norm(a)[..., None]


def weights(rng: np.random.Generator, count: int) -> Doubles:
    """Barycentric coordinates: anywhere in and around the triangle, or 1e-9 to 1e-2 off one edge or two."""
    anywhere = rng.uniform(-0.5, 1.2, (count, 3))
    close = np.sign(rng.uniform(-1, 1, (count, 3))) * 10 ** rng.uniform(-9, -2, (count, 3))
    close[:, 1] = np.where(rng.random(count) < 0.7, rng.random(count), close[:, 1])
    both = np.where((np.arange(count) % 2 == 0)[:, None], anywhere, close)
    both[:, 0] = 1 - both[:, 1] - both[:, 2]
    return rng.permuted(both, axis=1)


@pytest.fixture(scope="module")
def pairs() -> Pairs:
    """Triangles of 1e-3 to 1e3 m at 1e-2 to 1e4 m; half the rays aim at random, half close to an edge."""
    rng = np.random.default_rng(SEED)
    size = 10 ** rng.uniform(-3, 3, (PAIRS, 1))
    distance = np.maximum(10 ** rng.uniform(-2, 4, (PAIRS, 1)), 0.01 * size)
    origin = 10 ** rng.uniform(-1, 3, (PAIRS, 1)) * rng.normal(size=(PAIRS, 3))
    center = origin + distance * unit(rng.normal(size=(PAIRS, 3)))
    origin = origin.astype(np.float32)
    corners = (center[:, None] + size[:, None] * rng.normal(size=(PAIRS, 3, 3))).astype(np.float32)
    target = np.einsum("nv,nvi->ni", weights(rng, PAIRS), corners.astype(np.float64))
    direction = unit(target - origin).astype(np.float32)
    t, barycentric = moeller_trumbore(origin, direction, *np.moveaxis(corners, 1, 0))
    v = corners.astype(np.float64)
    n = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs(dot(direction.astype(np.float64), n)) / norm(n)
        height = norm(n)[:, None] / norm(np.roll(v, -1, axis=1) - np.roll(v, -2, axis=1))
    has_area = (height > 1e-6 * norm(v[:, 1] - v[:, 0])[:, None]).all(axis=1) & np.isfinite(t)
    assert has_area.mean() > 0.98
    return Pairs._make(a[has_area] for a in (origin, direction, corners, t, barycentric, cosine, height))


def worst(ratio: Doubles, what: str) -> str:
    k = int(np.argmax(ratio))
    return f"seed {SEED}: {what} is {ratio[k]:.3g} times its bound, at pair {k}"


def first(where: NDArray[np.bool_], what: str) -> str:
    return f"seed {SEED}: {where.sum()} {what}, at pairs {np.flatnonzero(where)[:5]}"


def reference_error(p: Pairs) -> Doubles:
    """|t - t_ref| of the reference form, t = w . n / (d . n) with w = V0 - O.

    w has u, its dot with n 3u, the dot d . n 3u |n|, the quotient u, a normalised n u in each dot, which makes
    (5 |w| + 5 t) u / |cos|. An error dn of the normal moves t by (P - V0) . dn / (|n| |cos|), and
    |dn| <= 4 sqrt(2) u |V1 - V0| |V2 - V0|: two roundings for the edges, one each for product and difference.
    """
    v0, v1, v2 = np.moveaxis(p.vertices, 1, 0)
    n = norm(np.cross(v1 - v0, v2 - v0))
    by_normal = 4 * np.sqrt(2) * norm(p.point - v0) * norm(v1 - v0) * norm(v2 - v0) / n
    return 1.1 * U * (5 * norm(v0) + 5 * np.abs(p.t) + by_normal) / p.cosine


def triage_error(p: Pairs) -> Doubles:
    """|t - t_ref| of float32 in the cast: as above, but with a normal computed in float64 and rounded."""
    v0 = p.vertices[:, 0]
    return 1.1 * U * (4 * norm(v0) + 4 * np.abs(p.t) + norm(p.point - v0)) / p.cosine


def reference_band(p: Pairs) -> Doubles:
    """(n, 3) how far, in barycentric coordinates, the reference form may misplace P.

    P is off by u (|P| + t) and the error of t. A sub-triangle's normal, dotted with n, has an error of 10u |a| |b|,
    a and b its sides at P: 4 sqrt(2) u for the cross product, 3u for the dot, u for n.
    """
    moved = U * (norm(p.origin + p.point) + np.abs(p.t)) + reference_error(p)
    sides = norm(p.vertices - p.point[:, None])
    a, b = np.roll(sides, -1, axis=1), np.roll(sides, -2, axis=1)
    v = p.vertices
    edge = norm(np.roll(v, -1, axis=1) - np.roll(v, -2, axis=1))
    return (moved[:, None] + 10 * U * a * b / edge) / p.height


def cast_band(p: Pairs) -> Doubles:
    """(n, 3) the same for the cast: a tilt of 1e-9 rad, and 1e-13 of the distances to the edge's ends, over |cos|."""
    v = norm(p.vertices)
    return (1.1e-9 * np.abs(p.t)[:, None] + 1e-13 * (np.roll(v, -1, axis=1) + np.roll(v, -2, axis=1))) / (
        p.cosine[:, None] * p.height
    )


def test_float32_is_never_wrong_where_it_decides(pairs: Pairs) -> None:
    """Without exception: what could be wrong is left to float64."""
    t = launchers.triage(*pairs.rays)
    is_decided = t != launchers.UNDECIDED
    wrong = is_decided & ((t < INF) != pairs.is_inside)
    assert not wrong.any(), first(wrong, "wrong")
    hit = is_decided & (t < INF)
    ratio = np.where(hit, np.abs(np.where(hit, t, 0) - pairs.t), 0) / triage_error(pairs)
    assert ratio.max() <= 1, worst(ratio, "|t - t_ref|")
    assert ratio.max() > 0.1, "the bound is loose"
    assert hit.sum() > PAIRS / 10


def test_float32_knows_how_far_off_it_may_be(pairs: Pairs) -> None:
    """The interval holds the distance, and is at most 20 times as wide as needed."""
    near, far = launchers.span(*pairs.rays).T.astype(np.float64)
    hit = np.isfinite(far)
    outside = hit & ((pairs.t < near) | (pairs.t > far))
    assert not outside.any(), first(outside, "outside of its span")
    near, far, t = near[hit], far[hit], pairs.t[hit]
    assert (np.abs(t - 0.5 * (near + far)) / (far - near)).max() > 0.025


def test_float32_decides_most_rays_that_are_not_aimed_at_edges(pairs: Pairs) -> None:
    """Rays at least 100u |V - O| / |cos| off the edges, of a triangle not seen edge-on, are decided in float32."""
    t = launchers.triage(*pairs.rays)
    far_off = 100 * U * norm(pairs.vertices).max(axis=1)[:, None] / (pairs.cosine[:, None] * pairs.height)
    is_plain = (np.abs(pairs.barycentric) > far_off).all(axis=1) & (pairs.cosine > 0.021) & (np.abs(pairs.t) > 1e-2)
    assert (t[is_plain] != launchers.UNDECIDED).mean() > 0.99
    assert is_plain.sum() > PAIRS / 4


def test_float64_decides_like_numpy_but_for_its_tilt(pairs: Pairs) -> None:
    t = launchers.decide(*pairs.rays)
    band = cast_band(pairs)
    is_clear = (np.abs(pairs.barycentric) > band).all(axis=1) & (pairs.cosine > 1e-8)
    wrong = is_clear & ((t < INF) != pairs.is_inside)
    assert not wrong.any(), first(wrong, "wrong")
    assert is_clear.mean() > 0.75
    # away from edges and from edge-on, the ray is not tilted
    is_plain = (np.abs(pairs.barycentric) > 1e3 * band).all(axis=1) & (pairs.cosine > 1e-6)
    hit = t < INF
    size = (norm(pairs.vertices).max(axis=1) + np.abs(pairs.t)) / pairs.cosine
    ratio = np.where(hit, np.abs(np.where(hit, t, 0) - pairs.t), 0) / (np.where(is_plain, 1e-14, 1e-9) * size)
    assert ratio.max() <= 1.1, worst(ratio, "|t - t_ref|")
    assert (hit & is_plain).mean() > 0.1


def test_a_distance_has_the_same_bits_for_any_order_of_the_vertices() -> None:
    """Vertices are on a grid, so that many share coordinates."""
    rng = np.random.default_rng(SEED)
    corners = (1 + 0.7 * rng.integers(0, 3, (10_000, 3, 3))).astype(np.float32)
    direction = unit(corners.mean(axis=1, dtype=np.float64))
    a, *others = (launchers.decide((0, 0, 0), direction, *corners[:, k].swapaxes(0, 1)) for k in ORDERS)
    assert (a < INF).mean() > 0.8
    for order, b in zip(ORDERS[1:], others, strict=True):
        assert (a == b).all(), first(a != b, f"otherwise in the order {order}")


def test_the_cast_is_float64s_but_for_a_billionth_around_the_edges(pairs: Pairs) -> None:
    t = launchers.intersect(*pairs.rays)
    is_clear = (np.abs(pairs.barycentric) > cast_band(pairs)).all(axis=1) & (pairs.cosine > 1e-8)
    wrong = is_clear & ((t < INF) != pairs.is_inside)
    assert not wrong.any(), first(wrong, "wrong")
    assert is_clear.mean() > 0.75


def test_reference_is_float64s_but_for_rounding(pairs: Pairs) -> None:
    t = launchers.reference(*pairs.rays)
    error = reference_error(pairs)
    is_steep = error < 0.1 * np.abs(pairs.t)  # elsewhere first order is not enough
    is_clear = is_steep & (np.abs(pairs.barycentric) > reference_band(pairs)).all(axis=1)
    wrong = is_clear & ((t < INF) != pairs.is_inside)
    assert not wrong.any(), first(wrong, "wrong")
    hit = is_steep & (t < INF)
    ratio = np.where(hit, np.abs(np.where(hit, t, 0) - pairs.t), 0) / error
    assert ratio.max() <= 1, worst(ratio, "|t - t_ref|")
    assert ratio.max() > 0.1, "the bound is loose"
    assert is_clear.mean() > 0.5


def test_the_cast_agrees_with_the_reference(pairs: Pairs) -> None:
    cast, reference = launchers.intersect(*pairs.rays), launchers.reference(*pairs.rays)
    is_steep = reference_error(pairs) < 0.1 * np.abs(pairs.t)
    is_clear = is_steep & (np.abs(pairs.barycentric) > reference_band(pairs) + cast_band(pairs)).all(axis=1)
    wrong = is_clear & ((cast < INF) != (reference < INF))
    assert not wrong.any(), first(wrong, "disagree")
    hit = is_steep & (cast < INF) & (reference < INF)
    bound = reference_error(pairs) + triage_error(pairs) + 1e-9 * np.abs(pairs.t) / pairs.cosine
    ratio = np.abs(cast[hit] - reference[hit]) / bound[hit]
    assert ratio.max() <= 1, worst(ratio, "|t - t_reference|")
    assert hit.sum() > PAIRS / 10


# ---- leaks


def fans(rng: np.random.Generator, count: int, blades: int) -> tuple[Doubles, Doubles]:
    """Apexes (count, 3) and rims (count, blades, 3) of closed fans around rays from 0, none of them flat."""
    apex = 10 ** rng.uniform(-2, 4, (count, 1)) * unit(rng.normal(size=(count, 3)))
    x = unit(np.cross(apex, rng.normal(size=(count, 3))))
    y = unit(np.cross(apex, x))
    angle = (np.arange(blades) + rng.uniform(0, 0.45, (count, blades))) * 2 * np.pi / blades
    radius = 10 ** rng.uniform(-3, 0, (count, 1)) * norm(apex)[:, None] * rng.uniform(0.5, 2, (count, blades))
    aside = np.cos(angle)[..., None] * x[:, None] + np.sin(angle)[..., None] * y[:, None]
    depth = rng.uniform(0.5, 2, (count, blades))[..., None]
    return apex, depth * (apex[:, None] + radius[..., None] * aside)


@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK], ids=["both sides", "front faces"])
@pytest.mark.parametrize("blades", [3, 4, 5, 6, 8])
@pytest.mark.parametrize("target", ["apex", "spoke"])
def test_no_ray_leaks_through_a_fan(blades: int, target: str, cull: int) -> None:
    """Rays aimed exactly at the shared vertex of the triangles, or at a point of a shared edge."""
    count = 10_000
    rng = np.random.default_rng(blades)
    apex, rim = (a.astype(np.float32) for a in fans(rng, count, blades))
    along = np.zeros((count, 1)) if target == "apex" else 10 ** rng.uniform(-6, -0.05, (count, 1))
    direction = unit(apex + along * (rim[:, 0].astype(np.float64) - apex)).astype(np.float32)
    hit = np.zeros(count, bool)
    for k in range(blades):
        hit |= launchers.intersect((0, 0, 0), direction, apex, rim[:, (k + 1) % blades], rim[:, k], cull) < INF
    assert hit.all(), f"seed {blades}: {(~hit).sum()} of {count} leak, first {np.flatnonzero(~hit)[:5]}"
