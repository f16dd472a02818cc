"""Rays aimed at points, edges and vertices of a mesh, none of which may let them through.

The mesh is that of the vertices after they were rounded to float32.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import islice
from typing import NamedTuple

import numpy as np
import trimesh
from made_worlds import Doubles, Mesh, Plan, cast_through, cube, grid, icosphere, mesh, turned, unit
from moeller_trumbore import dot, norm
from numpy.typing import NDArray

from rigcast.kernels.world.world import World

BATCH = 100_000
AWAY = np.array([0.6, -0.64, 0.48])  # where meshes are offset to
NEAR_END = 1e-4  # of an edge: nearer to a vertex, a turn by 1e-9 rad, which the cast may take, meets other faces
EDGE_ON = 0.05  # |cos| below which a target may lie on the mesh's outline
TOLERANCE = 3e-5  # of the distance and the mesh's size; the error of a distance is smaller down to |cos| = EDGE_ON


class Placed(NamedTuple):
    """A mesh in a world, with its place and size."""

    shape: Mesh
    world: World
    position: Doubles  # of the shape's pose
    middle: Doubles  # of the mesh, in its own frame
    size: float
    is_closed: bool


class Rays(NamedTuple):
    """Rays in the mesh's frame; a proper one surely hits the mesh at its target or before."""

    origins: Doubles
    targets: Doubles
    is_proper: NDArray[np.bool_]


def bumpy_sphere() -> Mesh:
    ball = icosphere(5)
    bumps = np.random.default_rng(6).uniform(0.8, 1.2, (len(ball.vertices), 1))
    return mesh(ball.vertices * bumps, ball.faces)


def uv_sphere() -> Mesh:
    """A sphere of 200 x 200 quadrangles; those at the poles are triangles, the others are split in two."""
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, 201)[1:-1], np.linspace(0, 2 * np.pi, 200, endpoint=False))
    rings = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    index = np.arange(200 * 199).reshape(200, 199)
    beside = np.roll(index, -1, axis=0)
    a, b, c, d = index[:, :-1], index[:, 1:], beside[:, 1:], beside[:, :-1]
    top, bottom = (np.full(200, 200 * 199 + k) for k in (0, 1))
    faces = [
        np.stack(corners, axis=-1).reshape(-1, 3)
        for corners in ((a, b, c), (a, c, d), (top, index[:, 0], beside[:, 0]), (bottom, beside[:, -1], index[:, -1]))
    ]
    return mesh([*rings.reshape(-1, 3), (0, 0, 1), (0, 0, -1)], np.concatenate(faces))


def fine_cube() -> Mesh:
    """A cube whose triangles, and with them the boxes of the tree, end in planes 1/8 apart."""
    box = trimesh.creation.box((2, 2, 2))
    for _ in range(4):
        box = box.subdivide()
    return mesh(box.vertices, box.faces)


MESHES: dict[str, Callable[[], Mesh]] = {
    "flat grid": lambda: grid(64),
    "turned grid": lambda: turned(grid(64), 3),
    "cube": cube,
    "sphere": uv_sphere,
    "bumpy sphere": bumpy_sphere,
    "fine cube": fine_cube,
    "icosphere": lambda: turned(icosphere(3), 2),
}


@cache
def place(name: str, scale: float, offset: float, is_baked: bool, device: str = "cpu") -> Placed | None:
    """One of MESHES in a world; None where its vertices, rounded to float32 at the offset, collapse.

    Args:
        offset: distance from the world's origin [m], in the shape's pose or else, baked, in the vertices.
    """
    shape = MESHES[name]()
    middle = offset * AWAY if is_baked else np.zeros(3)
    placed = mesh(scale * shape.vertices.astype(np.float64) + middle, shape.faces)
    if 2 * scale < 8 * np.spacing(np.float32(np.abs(middle).max())):
        return None
    plan = Plan()
    position = np.zeros(3) if is_baked else offset * AWAY
    plan.add_mesh(placed, position)
    ends = np.sort(np.stack([shape.faces, np.roll(shape.faces, -1, axis=1)], axis=-1), axis=-1)
    is_closed = bool((np.unique(ends.reshape(-1, 2), axis=0, return_counts=True)[1] == 2).all())
    return Placed(placed, plan.world(device), position, middle, scale, is_closed)


# ---- what to aim at


def parts(faces: NDArray[np.int64], aim: str) -> NDArray[np.int64]:
    """Numbers (m, k) of the parts at the corners of each face: vertices, edges that begin there, or the face itself."""
    if aim == "vertices":
        return faces
    if aim == "points":
        return np.arange(len(faces))[:, None]
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
    codes = ends[..., 0] * (faces.max() + 1) + ends[..., 1]
    return np.unique(codes, return_inverse=True)[1].reshape(faces.shape)


def is_within(faces: NDArray[np.int64], aim: str) -> NDArray[np.bool_]:
    """(m, k) whether each of `parts` lies off the mesh's border."""
    part = parts(faces, aim)
    if aim == "points":
        return np.ones(part.shape, bool)
    edges = parts(faces, "edges")
    is_border = np.asarray(np.bincount(edges.ravel())[edges] != 2)
    if aim == "edges":
        return ~is_border
    face, first = np.nonzero(is_border)
    return ~np.isin(part, [faces[face, first], faces[face, (first + 1) % 3]])


def points_on(corners: Doubles, first: NDArray[np.int64], aim: str, rng: np.random.Generator) -> Doubles:
    """Random points (n, 3) of the parts at corners `first` of triangles `corners` (n, 3, 3)."""
    rows = np.arange(len(first))
    a, b, c = (corners[rows, (first + k) % 3] for k in range(3))
    if aim == "vertices":
        return a
    s, r = rng.uniform(NEAR_END, 1 - NEAR_END, (2, len(first), 1))
    if aim == "points":
        return a + np.sqrt(s) * ((1 - r) * (b - a) + r * (c - a))
    # half of them in the middle or near the end
    special = np.where(rng.random(s.shape) < 0.5, 0.5, 10 ** rng.uniform(np.log10(NEAR_END), -1, s.shape))
    return a + np.where(rng.random(s.shape) < 0.5, special, s) * (b - a)


class Aims:
    """Targets on the points, edges or vertices of a mesh, and the faces that meet there."""

    def __init__(self, shape: Mesh, aim: str) -> None:
        self.aim = aim
        self.part = parts(shape.faces, aim)
        self.usable = np.argwhere(is_within(shape.faces, aim))
        self.corners = shape.corners.astype(np.float64)
        with np.errstate(invalid="ignore"):  # faces that have collapsed have a normal of NaN, and are never proper
            self.normals = unit(
                np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
            )
        self.star = np.argsort(self.part.ravel(), kind="stable") // self.part.shape[1]
        self.count = np.bincount(self.part.ravel())
        self.start = np.cumsum(self.count) - self.count

    def draw(self, rng: np.random.Generator, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Doubles]:
        """Faces (n,), parts (n,) and targets (n, 3)."""
        face, first = self.usable[rng.integers(0, len(self.usable), count)].T
        return face, self.part[face, first], points_on(self.corners[face], first, self.aim, rng)

    def is_proper(self, part: NDArray[np.int64], origins: Doubles, targets: Doubles) -> NDArray[np.bool_]:
        """Whether all faces around the target are seen from one side, none of them edge-on.

        Then they cover all that surrounds the target, as seen from the origin.
        """
        count = self.count[part]
        last = np.cumsum(count)
        ray = np.repeat(np.arange(len(part)), count)
        around = self.star[np.arange(last[-1]) + np.repeat(self.start[part] - last + count, count)]
        cosine = dot(self.normals[around], unit(origins - targets)[ray])
        least, most = (ufunc.reduceat(cosine, last - count) for ufunc in (np.minimum, np.maximum))
        return np.asarray((least > EDGE_ON) | (most < -EDGE_ON))


# ---- rays


def rays_from_outside(placed: Placed, aims: Aims, count: int, rng: np.random.Generator) -> Rays:
    """Proper rays from 1 to 3 sizes away; every second along the axis that is nearest to the face's normal."""
    face, part, targets = aims.draw(rng, count)
    normals = np.nan_to_num(aims.normals[face])
    away = unit(rng.normal(size=targets.shape))
    away[::2] = np.eye(3)[np.abs(normals[::2]).argmax(axis=1)]
    away *= np.where(dot(away, normals) < 0, -1, 1)[:, None]
    origins = targets + placed.size * rng.uniform(1, 3, (count, 1)) * away
    is_proper = aims.is_proper(part, origins, targets)
    return Rays(origins[is_proper], targets[is_proper], is_proper[is_proper])


def rays_from_inside(placed: Placed, aims: Aims, count: int, rng: np.random.Generator) -> Rays:
    """Rays from near the middle of a closed mesh; every second from planes 1/8 of its size apart, as in fine_cube."""
    _, part, targets = aims.draw(rng, count)
    origins = rng.uniform(-0.3, 0.3, targets.shape)
    origins[::2] = np.round(origins[::2] * 8) / 8
    origins = placed.middle + placed.size * origins
    return Rays(origins, targets, aims.is_proper(part, origins, targets))


def rays_all_around(placed: Placed, count: int, rng: np.random.Generator) -> Rays:
    origins = placed.middle + placed.size * rng.uniform(-0.3, 0.3, (count, 3))
    return Rays(origins, origins + placed.size * unit(rng.normal(size=(count, 3))), np.zeros(count, bool))


def rays_along_axes(placed: Placed, count: int, rng: np.random.Generator) -> Rays:
    """Rays along the axes from planes of a box's vertices; every second inwards from its faces."""
    planes = [np.unique(placed.shape.vertices[:, k].astype(np.float64)) for k in range(3)]
    origins = np.stack([p[rng.integers(1, len(p) - 1, count)] for p in planes], axis=-1)
    axis, sign = rng.integers(0, 3, count), rng.choice([-1, 1], count)
    rows = np.arange(0, count, 2)
    lowest, highest = (np.array([p[k] for p in planes])[axis[rows]] for k in (0, -1))
    origins[rows, axis[rows]] = np.where(sign[rows] > 0, lowest, highest)
    ahead = placed.size * sign[:, None] * np.eye(3)[axis]
    return Rays(origins, origins + ahead, np.zeros(count, bool))


def ray_batches(placed: Placed, aim: str, count: int, rng: np.random.Generator) -> Iterator[Rays]:
    """Endless batches of up to `count` rays. Closed meshes are aimed at from outside and from inside in turn."""
    if aim in ("points", "edges", "vertices"):
        aims = Aims(placed.shape, aim)
        while True:
            yield rays_from_outside(placed, aims, count, rng)
            if placed.is_closed:
                yield rays_from_inside(placed, aims, count, rng)
    while True:
        yield rays_all_around(placed, count, rng) if aim == "all around" else rays_along_axes(placed, count, rng)


def leaks(placed: Placed, rays: Rays, is_inside: bool) -> NDArray[np.bool_]:
    """(n,) which rays pass their proper target, or hit nothing from inside a closed mesh."""
    origins, targets = rays.origins + placed.position, rays.targets + placed.position
    got = cast_through(placed.world, origins, unit(targets - origins)).distance
    expected = norm(targets - origins)
    is_farther = ~(got <= expected + TOLERANCE * (expected + placed.size))
    return np.asarray((rays.is_proper & is_farther) | (is_inside & ~np.isfinite(got)))


def count_leaks(places: Sequence[Placed], aim: str, count: int, seed: int) -> tuple[list[int], int]:
    """How many of at least `count` rays leak in each of the places of one mesh, and how many rays there were.

    All places get the same rays, as it takes longer to make them than to cast them. Where few targets are proper, there
    are fewer rays.
    """
    rng = np.random.default_rng(seed)
    batch = min(BATCH, count)
    most = 4 + 6 * (count // batch)
    leaked, cast = [0] * len(places), 0
    for k, rays in enumerate(islice(ray_batches(places[0], aim, batch, rng), most)):
        # outside first, then inside; rays without a target all start inside
        is_inside = places[0].is_closed and (k % 2 == 1 or aim in ("all around", "along axes"))
        leaked = [n + int(leaks(placed, rays, is_inside).sum()) for n, placed in zip(leaked, places, strict=True)]
        cast += len(rays.origins)
        if cast >= count:
            break
    return leaked, cast
