"""The bounds on |t - t_ref| that rigcast.kernels.shapes.triangle and .solids derive hold, and are tight.

At least 1e6 rays of each kind, over offsets and scales of the shapes, are compared with float64 code apart from the
kernels: Möller and Trumbore's for triangles, and the roots of the equations of each solid's surfaces.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from made_worlds import NAME, Doubles, Plan, cast_through, mesh, random_rotations, unit
from moeller_trumbore import dot, moeller_trumbore, norm
from numpy.typing import NDArray

from rigcast.kernels.shapes.solids import BOX, CAPSULE, CYLINDER, ELLIPSOID, PLANE, SPHERE

EPS = 2.0**-23
INF = np.inf
OFFSETS = (0.0, 1e3, 1e4)
SCALES = (1e-3, 1.0, 1e3)
RAYS = 160_000  # at each offset and scale
TIGHT = 20


def check(ratios: list[Doubles], what: str) -> None:
    """Assert that errors over their bounds, for each offset and scale, are at most 1 and come close to it."""
    worst = np.array([r.max() for r in ratios])
    k = int(worst.argmax())
    where = f"{what}: seed {k}, ray {int(ratios[k].argmax())} of those judged: error / bound = {worst[k]:.3g}"
    assert worst[k] <= 1, where
    assert worst[k] >= 1 / TIGHT, f"{where}: the bound is loose"
    assert sum(map(len, ratios)) >= 1e6, f"{what}: only {sum(map(len, ratios))} rays"


# ---- triangles


def soup(rng: np.random.Generator, count: int) -> Doubles:
    """Triangles of 0.01 to 1 within a ball of radius 1: corners (n, 3, 3)."""
    size = 10 ** rng.uniform(-2, 0, (count, 1, 1))
    return np.asarray(
        unit(rng.normal(size=(count, 1, 3))) * rng.random((count, 1, 1)) + size * rng.normal(size=(count, 3, 3))
    )


def triangle_ratios(offset: float, scale: float, is_baked: bool, seed: int) -> Doubles:
    """Error over bound of each ray that hits."""
    rng = np.random.default_rng(seed)
    middle = unit(rng.normal(size=3)) * offset
    corners = scale * soup(rng, 300) + (middle if is_baked else 0)
    shape = mesh(corners.reshape(-1, 3), np.arange(900).reshape(-1, 3))
    position, rotation = (np.zeros(3), np.eye(3)) if is_baked else (middle, random_rotations(rng, 1)[0])
    plan = Plan()
    plan.add_mesh(shape, position, rotation)
    targets = middle + scale * rng.uniform(-1, 1, (RAYS, 3))
    origins = targets + scale * 10 ** rng.uniform(-1, 2, (RAYS, 1)) * unit(rng.normal(size=(RAYS, 3)))
    directions = unit(targets - origins)
    got = cast_through(plan.world(), origins, directions)
    hit = got.face >= 0
    o, d = (origins[hit] - position) @ rotation, directions[hit] @ rotation
    v0, v1, v2 = np.moveaxis(shape.corners[got.face[hit]].astype(np.float64), 1, 0)
    t, _ = moeller_trumbore(o, d, v0, v1, v2)
    n = np.cross(v1 - v0, v2 - v0)
    cosine = np.abs(dot(d, n)) / norm(n)
    farthest = np.max([norm(v - o) for v in (v0, v1, v2)], axis=0)
    ratio = np.abs(got.distance[hit] - t) * cosine / (3 * EPS * (farthest + t))
    return np.asarray(ratio[cosine > 1e-8])


@pytest.mark.parametrize("is_baked", [False, True], ids=["posed", "in vertices"])
def test_triangle(is_baked: bool) -> None:
    ratios = []
    for seed, (offset, scale) in enumerate((o, s) for o in OFFSETS for s in SCALES):
        if not (is_baked and offset > 0 and scale < 1):  # float32 cannot hold it
            ratios.append(triangle_ratios(offset, scale, is_baked, seed))
    check(ratios, "triangle")


# ---- closed forms


class Rays(NamedTuple):
    """Rays in the frame of a solid: origins and unit directions (n, 3)."""

    o: Doubles
    d: Doubles

    def at(self, t: Doubles) -> Doubles:
        return self.o + t[:, None] * self.d


class Truth(NamedTuple):
    """The first hit (n,), and which rays are judged: those not near a crease and, near a touch, precise in float64."""

    t: Doubles
    bound: Doubles
    is_clear: NDArray[np.bool_]


def roots(a: Doubles, b: Doubles, c: Doubles) -> Doubles:
    """The roots (2, n) of a t^2 + 2 b t + c, +inf where there are none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.sqrt(b * b - a * c)
        return np.nan_to_num(np.stack([(-b - s) / a, (-b + s) / a]), nan=INF, posinf=INF, neginf=INF)


def first(candidates: list[tuple[Doubles, NDArray[np.bool_]]]) -> Doubles:
    """The least t >= 0 among the candidates (t, whether it counts); +inf if there is none."""
    return np.stack([np.where(counts & (t >= 0), t, INF) for t, counts in candidates]).min(axis=0)


def is_known(cosine: Doubles, reach: Doubles, radius: float) -> NDArray[np.bool_]:
    """Whether b^2 - a c in `roots` is precise: near a touch it cancels in float64, unlike the kernels' form."""
    return np.asarray(cosine**2 > 64 * 2.0**-52 * (reach / radius) ** 2)


def sphere_truth(r: Rays, size: Doubles) -> Truth:
    t = first([(x, x == x) for x in roots(np.ones(len(r.o)), dot(r.o, r.d), dot(r.o, r.o) - size[0] ** 2)])
    hit = np.where(t < INF, t, 0)
    cosine = np.abs(dot(r.at(hit), r.d)) / size[0]
    return Truth(t, 7 * EPS * (norm(r.o) + t) / cosine, is_known(cosine, norm(r.o), size[0]))


def ellipsoid_truth(r: Rays, size: Doubles) -> Truth:
    o, d = r.o / size, r.d / size
    t = first([(x, x == x) for x in roots(dot(d, d), dot(o, d), dot(o, o) - 1)])
    hit = np.where(t < INF, t, 0)
    cosine = np.abs(dot(r.at(hit) / size, d)) / norm(d)
    bound = EPS * (7.5 * norm(o) / norm(d) + 13 * t) / cosine
    return Truth(t, bound, is_known(cosine, norm(o), 1))


def side_roots(r: Rays, radius: float) -> Doubles:
    o, d = r.o[:, :2], r.d[:, :2]
    return roots(dot(d, d), dot(o, d), dot(o, o) - radius**2)


def side_cosine(r: Rays, p: Doubles, radius: float) -> Doubles:
    return np.asarray(np.abs(dot(p[:, :2], r.d[:, :2])) / radius)


def cylinder_truth(r: Rays, size: Doubles) -> Truth:
    radius, half = size[:2]
    sides = [
        (t, np.abs(r.at(t)[:, 2]) <= half) for t in np.where(side_roots(r, radius) < INF, side_roots(r, radius), -1)
    ]
    caps = [(t, norm(r.at(t)[:, :2]) <= radius) for t in ((sign * half - r.o[:, 2]) / r.d[:, 2] for sign in (1, -1))]
    t, by_side = first(sides + caps), first(sides)
    hit = np.where(t < INF, t, 0)
    p = r.at(hit)
    side, cap = side_cosine(r, p, radius), np.abs(r.d[:, 2])
    flat = norm(r.o[:, :2])
    is_side = t == by_side
    cap_bound = EPS * (0.5 * np.abs(r.o[:, 2]) / cap + 3 * hit)
    bound = np.where(is_side, EPS * (7 * flat + 11 * hit) / side, cap_bound)
    room = 64 * EPS * (norm(r.o) + hit) / np.minimum(side, cap)
    is_off_rim = np.where(is_side, half - np.abs(p[:, 2]), radius - norm(p[:, :2])) > room
    return Truth(t, bound, np.asarray(is_off_rim & (is_known(side / norm(r.d[:, :2]), flat, radius) | ~is_side)))


def capsule_truth(r: Rays, size: Doubles) -> Truth:
    radius, half = size[:2]
    candidates = [
        (t, np.abs(r.at(t)[:, 2]) <= half) for t in np.where(side_roots(r, radius) < INF, side_roots(r, radius), -1)
    ]
    for end in (half, -half):
        o = r.o - (0, 0, end)
        found = roots(np.ones(len(o)), dot(o, r.d), dot(o, o) - radius**2)
        candidates += [(t, r.at(t)[:, 2] * np.sign(end) >= half) for t in np.where(found < INF, found, -1)]
    t = first(candidates)
    hit = np.where(t < INF, t, 0)
    p = r.at(hit)
    normal = (p - np.stack([0 * hit, 0 * hit, np.clip(p[:, 2], -half, half)], axis=-1)) / radius
    cosine = np.abs(dot(normal, r.d))
    reach = norm(r.o) + half + hit
    return Truth(t, 10 * EPS * reach / cosine, is_known(cosine, reach, radius))


def box_truth(r: Rays, size: Doubles) -> Truth:
    with np.errstate(divide="ignore"):
        faces = [((sign * size[k] - r.o[:, k]) / r.d[:, k], k) for k in range(3) for sign in (1, -1)]
    others = {0: [1, 2], 1: [0, 2], 2: [0, 1]}
    gaps = [np.min(size[others[k]] - np.abs(r.at(t)[:, others[k]]), axis=1) for t, k in faces]
    t = first([(t, gap >= 0) for (t, _), gap in zip(faces, gaps, strict=True)])
    which = np.argmax([x == t for x, _ in faces], axis=0)
    axis, rows = which // 2, np.arange(len(t))
    gap, cosine = np.array(gaps)[which, rows], np.abs(r.d[rows, axis])
    hit = np.where(t < INF, t, 0)
    bound = EPS * (0.5 * np.abs(r.o[rows, axis]) / cosine + 3 * hit)
    is_off_edge = gap > 64 * EPS * (norm(r.o) + hit) / np.abs(r.d).min(axis=1)
    return Truth(t, bound, np.asarray(is_off_edge))


def plane_truth(r: Rays, size: Doubles) -> Truth:
    t = -r.o[:, 2] / r.d[:, 2]
    is_above = (r.o[:, 2] > 0) & (t > 0)
    return Truth(np.where(is_above, t, INF), 2.5 * EPS * np.abs(t), np.asarray(np.abs(r.d[:, 2]) > 1e-6 + 0 * size[0]))


TRUTHS: dict[int, Callable[[Rays, Doubles], Truth]] = {
    PLANE: plane_truth,
    SPHERE: sphere_truth,
    CAPSULE: capsule_truth,
    ELLIPSOID: ellipsoid_truth,
    CYLINDER: cylinder_truth,
    BOX: box_truth,
}


def solid_ratios(kind: int, offset: float, scale: float, seed: int) -> Doubles:
    """Error over bound of rays at one solid, from within it to 1e5 times its size away, that hit it clearly."""
    rng = np.random.default_rng(seed)
    size = (scale * rng.uniform(0.2, 1, 3)).astype(np.float32).astype(np.float64) * (kind != PLANE)
    position, rotation = unit(rng.normal(size=3)) * offset, random_rotations(rng, 1)[0]
    plan = Plan()
    plan.add(kind, size, position, rotation)
    targets = 0.4 * scale * unit(rng.normal(size=(RAYS, 3))) * rng.random((RAYS, 1)) * (kind != PLANE)
    away = np.minimum(scale * 10 ** rng.uniform(-1, 5, (RAYS, 1)), np.maximum(100, 100 * scale))
    origins = targets + away * unit(rng.normal(size=(RAYS, 3)))
    if kind == PLANE:
        origins[:, 2] = np.abs(origins[:, 2])
    origins, targets = (a @ rotation.T + position for a in (origins, targets))
    directions = unit(targets - origins)
    got = cast_through(plan.world(), origins, directions).distance
    rays = Rays((origins - position) @ rotation, directions @ rotation)
    with np.errstate(invalid="ignore", divide="ignore"):
        truth = TRUTHS[kind](rays, size)
        judged = truth.is_clear & (truth.t < INF)
        return np.asarray(np.abs(got[judged] - truth.t[judged]) / truth.bound[judged])


@pytest.mark.parametrize("kind", TRUTHS, ids=lambda kind: NAME[kind])
def test_closed_form(kind: int) -> None:
    cases = [(offset, scale) for offset in OFFSETS for scale in SCALES]
    check([solid_ratios(kind, *case, seed) for seed, case in enumerate(cases)], NAME[kind])
