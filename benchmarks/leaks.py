"""How many rays slip through meshes without holes: `python benchmarks/leaks.py [rays] [device]`.

Two tables in Markdown, as docs/casting.md quotes them: the leak rates of other forms of the ray-triangle test, and ours
for every mesh, aim and offset, summed over three scales with this number of rays (350 000) each: about 10 minutes of
CPU time, half an hour for 1e6.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "kernels" / "helpers"))

import watertight
from made_worlds import Doubles, cast_through, unit
from numpy.typing import NDArray

COLUMNS = [(0.0, False), (1e3, False), (1e3, True), (1.5e5, False), (1.5e5, True)]
GROUPS = [[column for column in COLUMNS if not column[1]], *([column] for column in COLUMNS if column[1])]
SCALES = (1e-3, 1.0, 1e3)
MESHES = ("flat grid", "turned grid", "cube", "sphere", "bumpy sphere")

Corners = NDArray[np.floating]
Form = Callable[[Corners, Corners, Corners, Corners], NDArray[np.bool_]]


# ---- ours


def row(name: str, aim: str, count: int, device: str) -> list[tuple[int, int]]:
    """Leaks and rays over all scales, for each of COLUMNS. Where the pose alone differs, the rays are the same."""
    cells = dict.fromkeys(COLUMNS, (0, 0))
    for seed, scale in enumerate(SCALES):
        for group in GROUPS:
            places = [watertight.place(name, scale, *column, device) for column in group]
            placed = [each for each in places if each is not None]
            if placed:
                leaked, cast = watertight.count_leaks(placed, aim, count, seed)
                for column, found in zip(group, leaked, strict=True):
                    cells[column] = cells[column][0] + found, cells[column][1] + cast
    return list(cells.values())


def print_ours(count: int, device: str) -> None:
    rows = [(name, aim) for name in MESHES for aim in ("points", "edges", "vertices")]
    rows += [(name, "all around") for name in MESHES[2:]] + [("fine cube", "along axes")]
    heads = [
        f"{offset:g} m{' in vertices' if is_baked else ' in pose' if offset else ''}" for offset, is_baked in COLUMNS
    ]
    print("|", " | ".join(["mesh", "aimed at", *heads]), "|")
    print("|---" * (2 + len(COLUMNS)) + "|")
    for name, aim in rows:
        cells = (f"{a} of {b / 1e6:.2g} M" for a, b in row(name, aim, count, device))
        print("|", " | ".join([name, aim, *cells]), "|", flush=True)


# ---- other forms of the test: directions and vertices (n, 3) relative to the origin, in one precision


def dot(a: Corners, b: Corners) -> Corners:
    return np.asarray((a * b).sum(axis=-1, dtype=a.dtype))


def sub_triangles(d: Corners, a: Corners, b: Corners, c: Corners) -> NDArray[np.bool_]:
    """The definition: P on the plane, then the sides of P."""
    n = np.cross(b - a, c - a)
    p = (dot(a, n) / dot(d, n))[:, None] * d
    return np.all([dot(np.cross(y - x, p - x), n) >= 0 for x, y in ((a, b), (b, c), (c, a))], axis=0)


def moeller_trumbore(d: Corners, a: Corners, b: Corners, c: Corners) -> NDArray[np.bool_]:
    """Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", 1997."""
    e1, e2 = b - a, c - a
    p, q = np.cross(d, e2), np.cross(-a, e1)
    scale = 1 / dot(e1, p)
    u, v = dot(-a, p) * scale, dot(d, q) * scale
    return np.asarray((u >= 0) & (v >= 0) & (u + v <= 1))


def edge_sides(d: Corners, a: Corners, b: Corners, c: Corners) -> NDArray[np.bool_]:
    """d . (a x b), whose sign is opposite for the neighbour: numpy does not fuse a product and a sum."""
    s = np.array([dot(d, np.cross(x, y)) for x, y in ((a, b), (b, c), (c, a))])
    return np.asarray((s >= 0).all(axis=0) | (s <= 0).all(axis=0))


FORMS: dict[str, tuple[Form, type]] = {
    "P and three sub-triangles, float32": (sub_triangles, np.float32),
    "P and three sub-triangles, float64": (sub_triangles, np.float64),
    "Möller-Trumbore, float32": (moeller_trumbore, np.float32),
    "Möller-Trumbore, float64": (moeller_trumbore, np.float64),
    "edge sides d . (a x b), float32": (edge_sides, np.float32),
    "edge sides d . (a x b), float64": (edge_sides, np.float64),
}


def aimed_rays(aim: str, count: int) -> tuple[Doubles, Doubles, watertight.Placed, watertight.Aims, NDArray[np.int64]]:
    """Origins inside a turned icosphere, unit directions exactly at its edges or vertices, and the part aimed at."""
    placed = watertight.place("icosphere", 1.0, 0.0, False)
    assert placed is not None
    rng = np.random.default_rng(0)
    aims = watertight.Aims(placed.shape, aim)
    _, part, targets = aims.draw(rng, count)
    # float32 origins and float64 directions: what each form rounds is its own
    origins = rng.uniform(-0.5, 0.5, targets.shape).astype(np.float32).astype(np.float64)
    return origins, unit(targets - origins), placed, aims, part


def leak_rate(form: Form, dtype: type, aim: str, count: int) -> float:
    """The share of rays that miss every triangle around what they are aimed at."""
    origins, directions, _, aims, part = aimed_rays(aim, count)
    is_hit = np.zeros(count, bool)
    for k in range(int(aims.count.max())):
        ray = np.flatnonzero(aims.count[part] > k)
        corners = (aims.corners[aims.star[aims.start[part[ray]] + k]] - origins[ray, None]).astype(dtype)
        with np.errstate(divide="ignore", invalid="ignore"):
            is_hit[ray] |= form(directions[ray].astype(dtype), *np.moveaxis(corners, 1, 0))
    return float(1 - is_hit.mean())


def our_leak_rate(aim: str, count: int) -> float:
    origins, directions, placed, _, _ = aimed_rays(aim, count)
    return float(1 - np.isfinite(cast_through(placed.world, origins, directions).distance).mean())


def print_forms(count: int) -> None:
    print("| form | leaks at edges | leaks at vertices |\n|---|---|---|")
    for name, (form, dtype) in FORMS.items():
        rates = (leak_rate(form, dtype, aim, count) for aim in ("edges", "vertices"))
        print("|", " | ".join([name, *(f"{100 * rate:.2g} %" for rate in rates)]), "|", flush=True)
    rates = (our_leak_rate(aim, count) for aim in ("edges", "vertices"))
    print("|", " | ".join(["**rigcast**", *(f"{100 * rate:.2g} %" for rate in rates)]), "|\n", flush=True)


if __name__ == "__main__":
    rays = int(float(sys.argv[1])) if len(sys.argv) > 1 else 350_000
    print_forms(min(rays, 200_000))
    print_ours(rays, *(sys.argv[2:] or ["cpu"]))
