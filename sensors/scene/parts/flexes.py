"""The flexes of a model as a part of a scene: ropes, cloth and soft bodies, moving with their vertices."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.shapes import solids
from rigcast.kernels.world.arrays import Shapes
from rigcast.sensors.specs.filter import Filter, is_opaque

from .deforming import all_hidden, flat_surfaces, lost_owners, only_bodies
from .lost import Lost
from .part import Owner, Snapshot

_OUTWARD_SIDES = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
"""The sides of a tetrahedron, by MuJoCo's order of its vertices."""


class Flexes:
    """Every flex as `mj_rayFlex` sees it: 1D ones with `flg_edge`, 2D and 3D ones with `flg_skin`.

    Each edge is a capsule of `flex_radius`. A 2D flex has its elements besides, triangles that are hit from both
    sides, and a 3D one all four sides of each element of layer 0. Vertices are `flexvert_xpos` as it stands.

    The face of a hit is the element of a 2D flex; of a 3D one it is 4 k + i, side i of the k-th element of layer 0. It
    is -1 on an edge.

    Shapes: first the edges of all flexes, then one for the triangles of each 2D or 3D flex.
    """

    owner: Owner = "flex"

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        flexes = np.arange(model.nflex)
        self._flex_of_vertex = np.repeat(flexes, model.flex_vertnum)
        self._flex_of_edge = np.repeat(flexes, model.flex_edgenum)
        self._ends = model.flex_edge.reshape(-1, 2) + model.flex_vertadr[self._flex_of_edge, None]
        self._with_surface = np.flatnonzero(model.flex_dim > 1).tolist()
        self._kinds = np.where(model.flex_dim == 2, solids.SHEET, solids.TRIANGLES)[self._with_surface].tolist()
        self._elements = [_elements(model, flex) for flex in self._with_surface]
        faces = map(_faces, self._elements)
        self._surfaces = flat_surfaces(model.flex_vertnum[self._with_surface], faces)
        self.trees = [surface.tree for surface in self._surfaces]
        self.shapes = self._shapes(np.zeros(len(self._ends)))
        self.ids = np.concatenate([self._flex_of_edge, self._with_surface]).astype(np.int32)
        self._bodies = [_bodies(model, flex) for flex in flexes]
        self.bodies = only_bodies(self._bodies)[self.ids]
        self._lost = Lost(lambda flex: mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, flex) or f"flex {flex}")

    def update(self, data: mujoco.MjData) -> Snapshot:
        """The flexes as they stand in `data`. A flex with a vertex that is not finite is never hit."""
        # half of FARTHEST: the distance between two vertices must not pass it either
        lost = lost_owners(data.flexvert_xpos, self._flex_of_vertex, self.model.nflex, 0.5 * FARTHEST)
        self._lost.warn(data.time, ~lost)
        snapshot = self._place(np.where(lost[self._flex_of_vertex, None], 0.0, data.flexvert_xpos))
        snapshot.position[lost[self.ids]] = np.nan
        return snapshot

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        model = self.model
        collides = (model.flex_contype != 0) | (model.flex_conaffinity != 0)
        # mujoco's Python binding gives flex_matid as many entries as there are vertices
        opaque = is_opaque(model, model.flex_rgba, model.flex_matid[: model.nflex])
        seen = filter.admits(model.flex_group, collides) & opaque
        seen &= ~all_hidden(self._bodies, filter.hidden_bodies(model))
        return np.asarray(seen[self.ids])

    def _place(self, vertices: NDArray[np.float64]) -> Snapshot:
        """Shapes around finite vertices (nflexvert, 3)."""
        start, end = vertices[self._ends[:, 0]], vertices[self._ends[:, 1]]
        length, rotation = _frames_along(end - start)
        corners = [self._vertices(vertices, flex) for flex in self._with_surface]
        # relative to their mean, float32 is exact enough wherever the flex is
        centers = np.array([c.mean(axis=0) for c in corners]).reshape(-1, 3)
        moved = zip(self._surfaces, corners, centers, self._elements, strict=True)
        trees = {k: surface.move(c - center, _is_turned(c, own)) for k, (surface, c, center, own) in enumerate(moved)}
        self.trees = list(trees.values())
        position = np.concatenate([0.5 * (start + end), centers])
        rotation = np.concatenate([rotation, np.tile(np.eye(3).reshape(9), (len(trees), 1))])
        return Snapshot(position, rotation, self._shapes(0.5 * length), trees)

    def _shapes(self, half_length: NDArray[np.float64]) -> Shapes:
        edges = _capsules(self.model.flex_radius[self._flex_of_edge], half_length)
        surfaces = Shapes.of_trees(self._kinds, range(len(self.trees)), self.trees)
        return Shapes.joined([edges, surfaces], np.zeros(2, int))

    def _vertices(self, of_all: NDArray[np.float64], flex: int) -> NDArray[np.float64]:
        """The vertices of one flex, from those of all."""
        first = self.model.flex_vertadr[flex]
        return of_all[first : first + self.model.flex_vertnum[flex]]


def _elements(model: mujoco.MjModel, flex: int) -> NDArray[np.int32]:
    """The elements (n, dim + 1) that rays hit: all of a 2D flex, those in layer 0 of a 3D flex."""
    dim, first, count = model.flex_dim[flex], model.flex_elemdataadr[flex], model.flex_elemnum[flex]
    elements = model.flex_elem[first : first + (dim + 1) * count].reshape(count, dim + 1)
    layer = model.flex_elemlayer[model.flex_elemadr[flex] :][:count]
    return elements if dim == 2 else elements[layer == 0]


def _faces(elements: NDArray[np.int32]) -> NDArray[np.int32]:
    """Triangles (n, 3) of a 2D or 3D flex; for 3D counter-clockwise seen from outside their element."""
    return elements if elements.shape[1] == 3 else np.asarray(elements[:, _OUTWARD_SIDES].reshape(-1, 3))


def _is_turned(vertices: NDArray[np.float64], elements: NDArray[np.int32]) -> NDArray[np.bool_] | None:
    """Which faces (n,) of a 3D flex belong to elements that are now inside out; None for a 2D flex."""
    if elements.shape[1] == 3:
        return None
    a, b, c, last = (vertices[corner] for corner in elements.T)
    is_inside_out = np.einsum("ij,ij->i", np.cross(b - a, c - a), last - a) > 0
    return np.repeat(is_inside_out, len(_OUTWARD_SIDES))


def _bodies(model: mujoco.MjModel, flex: int) -> NDArray[np.int32]:
    """The bodies that carry the vertices of a flex, or the nodes between which they are interpolated."""
    vertices = model.flex_vertbodyid[model.flex_vertadr[flex] :][: model.flex_vertnum[flex]]
    nodes = model.flex_nodebodyid[model.flex_nodeadr[flex] :][: model.flex_nodenum[flex]]
    return np.unique(nodes if len(nodes) else vertices)


def _capsules(radius: NDArray[np.float64], half_length: NDArray[np.float64]) -> Shapes:
    """Capsules along z."""
    zero = np.zeros_like(radius)
    count = len(radius)
    half = np.stack([radius, radius, radius + half_length], axis=-1) * (1 + 1e-6)
    return Shapes(
        np.full(count, solids.CAPSULE, np.int32),
        np.stack([radius, half_length, zero], axis=-1).astype(np.float32),
        np.full(count, -1, np.int32),
        np.zeros((count, 3), np.float32),
        half.astype(np.float32),
    )


def _frames_along(vectors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lengths (n,) of vectors (n, 3), and rotations (n, 9) whose z axis is along them; +z where the length is 0.

    Duff et al., "Building an orthonormal basis, revisited", JCGT 2017.
    """
    x, y, z = vectors.T
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = np.where(length > 0, vectors.T, [[0.0], [0.0], [1.0]]) / np.where(length > 0, length, 1.0)
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    rows = [1.0 + sign * x * x * a, b, x, sign * b, sign + y * y * a, y, -sign * x, -y, z]
    return length, np.stack(rows, axis=-1)
