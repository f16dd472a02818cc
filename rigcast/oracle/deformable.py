"""`mj_rayFlex` and `mju_raySkin`, ray by ray in float64: MuJoCo's own hits of rays on flexes and skins.

mj_ray sees neither. From Python, MuJoCo 4 is the first whose functions can be called on all of them.
"""

import copy
from abc import ABC, abstractmethod
from typing import NamedTuple

import mujoco
import numpy as np

from rigcast.oracle.ray import Bools, Floats, Ints, RayHits
from rigcast.sensors.specs.filter import Filter, is_opaque

CAN_JUDGE = int(mujoco.__version__.split(".")[0]) >= 4
ON_FACE = 1e-7  # of a triangle's size: points within this distance count as on it


class _Surfaces(ABC):
    """Code shared by flexes and skins, which MuJoCo casts one at a time."""

    def __init__(self, seen: Bools, vertices: list[Floats], margin: Floats) -> None:
        """seen (n,): which there are to hit; vertices (n of (m, 3)): in the world; margin (n,): how far they reach."""
        self.count = len(seen)
        self._seen = seen
        self._center = np.array([points.mean(axis=0) for points in vertices])
        reach = [np.linalg.norm(points - c, axis=1).max() for points, c in zip(vertices, self._center, strict=True)]
        self._reach = 1.01 * (np.array(reach) + margin)

    def cast(self, origins: Floats, directions: Floats) -> RayHits:
        """Return what rays, (n, 3) origins and unit directions, hit; `geom_id` is the flex's or skin's own id."""
        first = RayHits.misses(len(origins))
        for k in range(self.count):
            hits = self.cast_at(origins, directions, np.full(len(origins), k, np.int32))
            nearer = hits.distance < first.distance
            first.put(nearer, hits.take(nearer))
        return first

    def cast_at(self, origins: Floats, directions: Floats, ids: Ints, normals: Floats | None = None) -> RayHits:
        """Return what each ray hits when the flex or skin `ids` (n,) is all that it could hit.

        Of several faces in one place it is the one whose normal is next to `normals` (n, 3), or the first.
        """
        hits = RayHits.misses(len(ids))
        for k in np.unique(ids[ids >= 0]):
            near = (ids == k) & self._seen[k] & self._may_meet(int(k), origins, directions)
            for ray in np.flatnonzero(near):
                distance, found = self._hit(int(k), origins[ray], directions[ray])
                if distance >= 0:
                    one = 0 if normals is None else np.argmax(found @ normals[ray])
                    hits.distance[ray], hits.geom_id[ray], hits.normal[ray] = distance, k, found[one]
        return hits

    def _may_meet(self, k: int, origins: Floats, directions: Floats) -> Bools:
        """Return (n,) whether a ray's line meets the ball around object k; True if the ball is not finite."""
        to = self._center[k] - origins
        nearest = to - (to * directions).sum(axis=1, keepdims=True) * directions
        return ~(np.linalg.norm(nearest, axis=1) > self._reach[k])

    @abstractmethod
    def _hit(self, k: int, origin: Floats, direction: Floats) -> tuple[float, Floats]:
        """Return the distance to one of them, < 0 on a miss, and the outward unit normals (m, 3) of what lies there."""


class Flexes(_Surfaces):
    """Flexes: 1D ones are cast with `flg_edge`, as capsules, 2D and 3D ones with `flg_skin`, layer 0.

    The face of a 2D flex has two outer sides: its normal is turned to the ray's origin. That of a 3D one points out of
    its element; where two elements meet, which only rays from inside can see, out of either.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, filter: Filter) -> None:
        bodies = [_flex_bodies(model, flex) for flex in range(model.nflex)]
        collides = (model.flex_contype != 0) | (model.flex_conaffinity != 0)
        # mujoco's Python binding gives flex_matid as many entries as there are vertices
        opaque = is_opaque(model, model.flex_rgba, model.flex_matid[: model.nflex])
        seen = filter.admits(model.flex_group, collides) & opaque & ~_hidden(model, filter, bodies)
        super().__init__(seen, [_flex_vertices(model, data, k) for k in range(model.nflex)], model.flex_radius)
        self._model, self._data = model, data
        self._sides = [_outward_sides(model, data, flex) for flex in range(model.nflex)]

    def _hit(self, k: int, origin: Floats, direction: Floats) -> tuple[float, Floats]:
        is_line = self._model.flex_dim[k] == 1
        where = (self._model, self._data, 0, False)
        ray = (k, origin[:, None], direction[:, None])
        normal, vertex = np.zeros((3, 1)), np.zeros((1, 1), np.int32)
        distance = mujoco.mj_rayFlex(*where, is_line, False, not is_line, *ray, vertex, normal)
        if distance < 0 or is_line or mujoco.mj_rayFlex(*where, True, False, False, *ray, None, None) == distance:
            return distance, normal.T  # the normal of an edge, a capsule, is outward already
        if self._model.flex_dim[k] == 3:
            return distance, self._sides[k][vertex[0, 0]].normals_at(origin + distance * direction)
        return distance, -normal.T if direction @ normal > 0 else normal.T


class Skins(_Surfaces):
    """Skins with the vertices of `mjv_updateScene`, relative to the mean of their bones, because these are float32."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, filter: Filter) -> None:
        bodies = [_bone_bodies(model, skin) for skin in range(model.nskin)]
        opaque = is_opaque(model, model.skin_rgba, model.skin_matid)
        groups = filter.admits(model.skin_group, np.zeros(model.nskin, bool))
        self._origin = [data.xpos[of].mean(axis=0) for of in bodies]
        self._vertices = [_skin_vertices(model, data, k, origin) for k, origin in enumerate(self._origin)]
        placed = [vertices + origin for vertices, origin in zip(self._vertices, self._origin, strict=True)]
        super().__init__(groups & opaque & ~_hidden(model, filter, bodies), placed, np.zeros(model.nskin))
        first, count = model.skin_faceadr, model.skin_facenum
        self._faces = [model.skin_face[first[k] : first[k] + count[k]].reshape(-1, 3) for k in range(self.count)]
        self._around = [
            _around(faces, vertices.astype(np.float64))
            for faces, vertices in zip(self._faces, self._vertices, strict=True)
        ]

    def _hit(self, k: int, origin: Floats, direction: Floats) -> tuple[float, Floats]:
        start, vertex = origin - self._origin[k], np.zeros((1, 1), np.int32)
        faces, vertices = self._faces[k], self._vertices[k]
        flat = faces.reshape(-1, 1), vertices.reshape(-1, 1)
        distance = mujoco.mju_raySkin(len(faces), len(vertices), *flat, start[:, None], direction[:, None], vertex)
        if distance < 0:
            return distance, np.zeros((1, 3))
        return distance, self._around[k][vertex[0, 0]].normals_at(start + distance * direction)


class _Fan(NamedTuple):
    """The m triangles around a vertex.

    corner (m, 3), normal (m, 3): one corner of each, and its unit winding normal; size (m,): the length of an edge;
    starts, inward (m, 3, 3): of each edge its start, and the unit vector into the triangle.
    """

    corner: Floats
    normal: Floats
    size: Floats
    starts: Floats
    inward: Floats

    @classmethod
    def of(cls, corners: Floats) -> "_Fan":
        """From the corners (m, 3, 3) of triangles with an area."""
        along = np.roll(corners, -1, axis=1) - corners
        normal = _unit(np.cross(along[:, 0], along[:, 1]))
        inward = _unit(np.cross(normal[:, None], along))
        return cls(corners[:, 0], normal, np.linalg.norm(along[:, 0], axis=1), corners, inward)

    def normals_at(self, point: Floats) -> Floats:
        """Return (k, 3) the winding normals of the triangles on which a point (3,) lies: at least one."""
        off_plane = np.abs(((point - self.corner) * self.normal).sum(axis=1))
        off_edges = -((point - self.starts) * self.inward).sum(axis=2).min(axis=1)
        outside = np.maximum(off_plane, off_edges)
        found: Floats = self.normal[outside <= outside.min() + ON_FACE * self.size]
        return found


def _unit(vectors: Floats) -> Floats:
    normalised: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return normalised


def _around(faces: Ints, vertices: Floats) -> list[_Fan]:
    """Return for each vertex (n, 3) the faces (f, 3) around it that have an area."""
    corners = vertices[faces]
    has_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0
    corners, faces = corners[has_area], faces[has_area]
    face_of = np.argsort(faces.reshape(-1), kind="stable")
    ends = np.cumsum(np.bincount(faces.reshape(-1), minlength=len(vertices)))
    return [_Fan.of(corners[np.sort(of // 3)]) for of in np.split(face_of, ends[:-1])]


def _outward_sides(model: mujoco.MjModel, data: mujoco.MjData, flex: int) -> list[_Fan]:
    """Return for each vertex of a 3D flex the sides of elements around it, wound as seen from outside."""
    if model.flex_dim[flex] != 3:
        return []
    vertices = _flex_vertices(model, data, flex)
    count = model.flex_elemnum[flex]
    elements = model.flex_elem[model.flex_elemdataadr[flex] :][: 4 * count].reshape(count, 4)
    elements = elements[model.flex_elemlayer[model.flex_elemadr[flex] :][:count] == 0]
    corners = vertices[elements]
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1])
    elements = np.where(volume[:, None] < 0, elements[:, [0, 1, 3, 2]], elements)
    sides = elements[:, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]].reshape(-1, 3)
    return _around(sides, vertices)


def _flex_vertices(model: mujoco.MjModel, data: mujoco.MjData, flex: int) -> Floats:
    return data.flexvert_xpos[model.flex_vertadr[flex] :][: model.flex_vertnum[flex]]


def _skin_vertices(model: mujoco.MjModel, data: mujoco.MjData, skin: int, center: Floats) -> np.ndarray:
    """Return (n, 3) float32, the vertices of a skin less `center`, as MuJoCo's visualizer computes them."""
    there, scene, option = copy.copy(data), mujoco.MjvScene(model, 1), mujoco.MjvOption()
    there.xpos -= center
    option.skingroup[:] = 1
    mujoco.mjv_updateScene(model, there, option, None, mujoco.MjvCamera(), 0, scene)
    vertices = np.array(scene.skinvert, np.float32).reshape(-1, 3)
    return vertices[model.skin_vertadr[skin] :][: model.skin_vertnum[skin]]


def _hidden(model: mujoco.MjModel, filter: Filter, bodies: list[Ints]) -> Bools:
    """Return (n,) True where all bodies of a flex or skin are hidden."""
    hidden = filter.hidden_bodies(model)
    return np.array([hidden[of].all() for of in bodies], bool)


def _flex_bodies(model: mujoco.MjModel, flex: int) -> Ints:
    """Return the bodies of the vertices of a flex, or of the nodes between which they are interpolated."""
    nodes = model.flex_nodebodyid[model.flex_nodeadr[flex] :][: model.flex_nodenum[flex]]
    return nodes if len(nodes) else model.flex_vertbodyid[model.flex_vertadr[flex] :][: model.flex_vertnum[flex]]


def _bone_bodies(model: mujoco.MjModel, skin: int) -> Ints:
    return model.skin_bonebodyid[model.skin_boneadr[skin] :][: model.skin_bonenum[skin]]
