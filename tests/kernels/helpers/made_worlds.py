"""Worlds made of meshes and solids, rays cast through them, and the results as numpy arrays."""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import trimesh
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.cast import cast
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.shapes import solids
from rigcast.kernels.shapes.triangle import CULL_NONE
from rigcast.kernels.world.arrays import Shapes, TriangleTree
from rigcast.kernels.world.height_field import build_height_field
from rigcast.kernels.world.triangle_tree import build_triangle_tree
from rigcast.kernels.world.world import World

Doubles = NDArray[np.float64]
KINDS = (solids.PLANE, solids.SPHERE, solids.CAPSULE, solids.ELLIPSOID, solids.CYLINDER, solids.BOX)
NAME = dict(zip(KINDS, ("plane", "sphere", "capsule", "ellipsoid", "cylinder", "box"), strict=True))


class Mesh(NamedTuple):
    """vertices (n, 3) float32, faces (m, 3), counter-clockwise from outside."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.int64]

    @property
    def corners(self) -> NDArray[np.float32]:
        """(m, 3 vertices, 3)"""
        return self.vertices[self.faces]


def mesh(vertices: ArrayLike, faces: ArrayLike) -> Mesh:
    return Mesh(np.asarray(vertices, np.float32), np.asarray(faces, np.int64))


def cube() -> Mesh:
    box = trimesh.creation.box((2, 2, 2))
    return mesh(box.vertices, box.faces)


def icosphere(subdivisions: int = 3) -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions)
    return mesh(sphere.vertices, sphere.faces)


def torus() -> Mesh:
    ring = trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12)
    return mesh(ring.vertices, ring.faces)


def grid(cells: int, bumps: float = 0.0, seed: int = 0) -> Mesh:
    """|x|, |y| <= 1, z up, with vertices up to `bumps` above and below 0."""
    x = np.linspace(-1, 1, cells + 1)
    z = np.random.default_rng(seed).uniform(-bumps, bumps, (cells + 1, cells + 1))
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return mesh(np.stack([*np.meshgrid(x, x), z], axis=-1).reshape(-1, 3), faces)


class Field(NamedTuple):
    """A height field: its tree, and the same triangles as a mesh, with the same face numbers."""

    tree: TriangleTree
    mesh: Mesh


def field(rows: int, columns: int, bumps: float, seed: int = 0) -> Field:
    """A field of rows x columns heights from 0.5 to 0.5 + `bumps` [m], 2 m along x and 3 m along y, with a wall at its
    last column and a base."""
    x, y = np.linspace(-1, 1, columns).astype(np.float32), np.linspace(-1.5, 1.5, rows).astype(np.float32)
    z = np.random.default_rng(seed).uniform(0.5, 0.5 + bumps, (rows, columns)).astype(np.float32)
    surface = np.stack([*np.meshgrid(x, y), z], axis=-1)
    top = surface[:, -1]
    foot = top * (1, 1, 0)
    wall = np.stack([foot[:-1], foot[1:], top[1:], foot[:-1], top[1:], top[:-1]], axis=1).reshape(-1, 3, 3)
    base = np.array([[(-1, -1.5, 0), (1, 1.5, 0), (1, -1.5, 0)], [(-1, -1.5, 0), (-1, 1.5, 0), (1, 1.5, 0)]])
    a, b, c, d = surface[:-1, :-1], surface[:-1, 1:], surface[1:, 1:], surface[1:, :-1]
    corners = np.concatenate([np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3), wall, base])
    whole = mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return Field(build_height_field(x, y, z, [wall, base]), whole)


def turned(shape: Mesh, seed: int) -> Mesh:
    """The mesh, turned at random before it is rounded to float32."""
    return mesh(shape.vertices @ random_rotations(np.random.default_rng(seed), 1)[0].T, shape.faces)


def random_rotations(rng: np.random.Generator, count: int) -> Doubles:
    """(count, 3, 3)"""
    q, r = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    q *= np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None]
    return np.asarray(q * np.sign(np.linalg.det(q))[:, None, None])


def unit(a: Doubles) -> Doubles:
    return np.asarray(a / np.linalg.norm(a, axis=-1, keepdims=True))


def half_size(kind: int, size: ArrayLike) -> Doubles:
    """Half sizes (3,) of the box around a closed form; inf along an unbounded axis of a plane."""
    x, y, z = np.asarray(size, np.float64)
    boxes = {
        solids.PLANE: (x or np.inf, y or np.inf, 0),
        solids.SPHERE: (x, x, x),
        solids.CAPSULE: (x, x, x + y),
        solids.CYLINDER: (x, x, y),
    }
    return np.array(boxes.get(kind, (x, y, z)))


@dataclass
class Plan:
    """Shapes and poses from which a World is made."""

    trees: list[TriangleTree] = dataclasses.field(default_factory=list)
    kind: list[int] = dataclasses.field(default_factory=list)
    size: list[Doubles] = dataclasses.field(default_factory=list)
    tree: list[int] = dataclasses.field(default_factory=list)
    center: list[Doubles] = dataclasses.field(default_factory=list)
    half: list[Doubles] = dataclasses.field(default_factory=list)
    position: list[Doubles] = dataclasses.field(default_factory=list)
    rotation: list[Doubles] = dataclasses.field(default_factory=list)

    def add(
        self, kind: int, size: ArrayLike, position: ArrayLike = (0, 0, 0), rotation: ArrayLike | None = None
    ) -> None:
        self._add(kind, np.asarray(size, np.float64), -1, np.zeros(3), half_size(kind, size), position, rotation)

    def add_mesh(self, shape: Mesh | int, position: ArrayLike = (0, 0, 0), rotation: ArrayLike | None = None) -> None:
        """Add a mesh, or another instance of mesh number `shape`."""
        if isinstance(shape, Mesh):
            self.add_tree(build_triangle_tree(shape.vertices, shape.faces), position, rotation)
        else:
            self._add(solids.TRIANGLES, np.zeros(3), shape, *self._box(shape), position, rotation)

    def add_tree(self, tree: TriangleTree, position: ArrayLike = (0, 0, 0), rotation: ArrayLike | None = None) -> None:
        self.trees.append(tree)
        index = len(self.trees) - 1
        self._add(solids.TRIANGLES, np.zeros(3), index, *self._box(index), position, rotation)

    def replace_mesh(self, index: int, shape: Mesh) -> None:
        self.trees[index] = build_triangle_tree(shape.vertices, shape.faces)
        for k in np.flatnonzero(np.array(self.tree) == index):
            self.center[k], half = self._box(index)
            self.half[k] = half * (1 + 1e-6)

    def _box(self, index: int) -> tuple[Doubles, Doubles]:
        """Centre and half size of a tree."""
        lower, upper = self.trees[index].lower.astype(np.float64), self.trees[index].upper.astype(np.float64)
        return (lower + upper) / 2, (upper - lower) / 2

    def _add(
        self,
        kind: int,
        size: Doubles,
        tree: int,
        center: Doubles,
        half: Doubles,
        position: ArrayLike,
        rotation: ArrayLike | None,
    ) -> None:
        self.kind.append(kind)
        self.size.append(size)
        self.tree.append(tree)
        self.center.append(center)
        self.half.append(half * (1 + 1e-6))
        self.position.append(np.asarray(position, np.float64))
        self.rotation.append(np.eye(3) if rotation is None else np.asarray(rotation, np.float64))

    @property
    def shapes(self) -> Shapes:
        size, middle, half = (np.reshape(a, (-1, 3)) for a in (self.size, self.center, self.half))
        center = middle.astype(np.float32)
        half = half + np.abs(middle - center) * (1 + 1e-6)  # the rounded box holds the shape
        kind, tree = np.array(self.kind, np.int32), np.array(self.tree, np.int32)
        return Shapes(kind, size.astype(np.float32), tree, center, half.astype(np.float32))

    def poses(self) -> tuple[Doubles, Doubles]:
        """Position (n, 3) and rotation (n, 9), as World.update takes them."""
        return np.array(self.position).reshape(-1, 3), np.array(self.rotation).reshape(-1, 9)

    def world(self, device: str = "cpu") -> World:
        """The world, updated."""
        world = World(self.trees, self.shapes, device)
        world.update(*self.poses())
        return world


def world_of(*meshes: Mesh) -> World:
    """A world of meshes, each with the identity as its pose."""
    plan = Plan()
    for shape in meshes:
        plan.add_mesh(shape)
    return plan.world()


def random_plan(seed: int, count: int = 40, spread: float = 4.0) -> Plan:
    """Solids of every kind, planes finite and infinite, instances of two meshes, and a height field."""
    rng = np.random.default_rng(seed)
    plan = Plan()
    plan.add_mesh(icosphere(2), rng.uniform(-spread, spread, 3), random_rotations(rng, 1)[0])
    plan.add_mesh(turned(grid(12, 0.1, seed), seed), rng.uniform(-spread, spread, 3))
    plan.add(solids.PLANE, (0, 0, 0), (0, 0, -spread))
    for _ in range(count - 3):
        where = rng.uniform(-spread, spread, 3), random_rotations(rng, 1)[0]
        kind = int(rng.integers(0, 8))
        if kind in KINDS:
            plan.add(kind, rng.uniform(0.1, 0.8, 3), *where)
        else:
            plan.add_mesh(kind - 6, *where)
    plan.add_tree(field(12, 17, 0.3, seed).tree, rng.uniform(-spread, spread, 3), random_rotations(rng, 1)[0])
    return plan


class Hits(NamedTuple):
    """What cast returns, as numpy arrays (n, ...)."""

    distance: NDArray[np.float32]
    shape: NDArray[np.int32]
    face: NDArray[np.int32]
    normal: NDArray[np.float32]


def rays_of(origins: ArrayLike, directions: ArrayLike, device: str = "cpu") -> Rays:
    """Rays in the world's own frame: origins (n, 3) or (3,), unit directions (n, 3) or (3,)."""
    o, d = (np.ascontiguousarray(np.asarray(a, np.float64).reshape(-1, 3)) for a in (origins, directions))
    d = np.ascontiguousarray(np.broadcast_to(d, (len(o) if len(d) == 1 else len(d), 3)))
    return Rays(
        wp.array(d, dtype=wp.vec3d, device=device),
        wp.array(o, dtype=wp.vec3d, device=device),
        wp.zeros(1, dtype=wp.vec3d, device=device),
        wp.array(np.eye(3)[None], dtype=wp.mat33d, device=device),
    )


def cast_through(
    world: World,
    origins: ArrayLike,
    directions: ArrayLike,
    limit: float = np.inf,
    cull: int = CULL_NONE,
    visible: ArrayLike = True,
) -> Hits:
    device = str(world.device)
    seen = np.ascontiguousarray(np.broadcast_to(np.asarray(visible, bool), len(world.geometry.kind)))
    rays = rays_of(origins, directions, device)
    hits = cast(world.geometry, wp.array(seen, dtype=wp.bool, device=device), rays, limit, cull)
    return Hits(hits.distance.numpy(), hits.shape.numpy(), hits.face.numpy(), hits.normal.numpy())


def assert_same(got: Hits, expected: Hits, message: str = "") -> None:
    """Assert that all hits are equal; NaN equals NaN."""
    for name, a, b in zip(Hits._fields, got, expected, strict=True):
        differ = np.flatnonzero(
            ~((a == b) | ((a != a) & (b != b))).reshape(len(a), a[0].size if len(a) else 1).all(axis=1)
        )
        assert not len(differ), (
            f"{message}: {name} of {len(differ)} rays, ray {differ[0]}: got {a[differ[0]]}, expected {b[differ[0]]}"
        )


def random_rays(seed: int, count: int, spread: float = 6.0) -> tuple[Doubles, Doubles]:
    """Origins and unit directions (n, 3); every tenth direction is along an axis."""
    rng = np.random.default_rng(seed)
    directions = unit(rng.normal(size=(count, 3)))
    directions[::10] = np.eye(3)[rng.integers(0, 3, len(directions[::10]))] * rng.choice(
        [-1, 1], (len(directions[::10]), 1)
    )
    return rng.uniform(-spread, spread, (count, 3)), directions
