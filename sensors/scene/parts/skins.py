"""The skins of a model as a part of a scene: meshes that follow several bodies, their bones."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.shapes import solids
from rigcast.kernels.world.arrays import Shapes
from rigcast.sensors.rotations import rotation_matrix
from rigcast.sensors.specs.filter import Filter, is_opaque

from .deforming import all_hidden, flat_surfaces, lost_owners, only_bodies
from .lost import Lost
from .part import Owner, Snapshot


class Skins:
    """Shape k is skin k, with the vertices that `mjv_updateSkin` computes. Its normals are those of the winding.

    Bone b with bind pose (p, q) has moved by R = xmat q^-1 and t = xpos - R p since skin and bones were joined; a
    vertex v is at the mean of R v + t over its bones, by their weights. `skin_inflate` then moves it along the mean of
    the normals around it, by their areas.
    """

    owner: Owner = "skin"

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        skins = np.arange(model.nskin)
        self._skin_of_bone = np.repeat(skins, model.skin_bonenum)
        self._skin_of_vertex = np.repeat(skins, model.skin_vertnum)
        skin_of_face = np.repeat(skins, model.skin_facenum)
        # influences, each of a bone on a vertex
        self._bone = np.repeat(np.arange(model.nskinbone), model.skin_bonevertnum)
        self._vertex = model.skin_bonevertid + model.skin_vertadr[self._skin_of_bone[self._bone]]
        faces = model.skin_face.reshape(-1, 3)
        self._faces = faces + model.skin_vertadr[skin_of_face, None]
        self._surfaces = flat_surfaces(model.skin_vertnum, (faces[skin_of_face == skin] for skin in skins))
        self.trees = [surface.tree for surface in self._surfaces]
        self.shapes = self._shapes()
        self.ids = skins.astype(np.int32)
        self._bodies = [np.unique(model.skin_bonebodyid[self._skin_of_bone == skin]) for skin in skins]
        self.bodies = only_bodies(self._bodies)
        self._lost = Lost(lambda skin: model.skin(skin).name or f"skin {skin}")

    def update(self, data: mujoco.MjData) -> Snapshot:
        """The skins as they stand in `data`. A skin with a vertex that is not finite is never hit."""
        count = self.model.nskin
        bones = data.xpos[self.model.skin_bonebodyid]
        # relative to the mean of its bones, float32 is exact enough wherever the skin is
        position = _sums(self._skin_of_bone, bones, count) / np.bincount(self._skin_of_bone, minlength=count)[:, None]
        with np.errstate(invalid="ignore", over="ignore"):
            vertices = self._inflated(self._bent(data, bones - position[self._skin_of_bone]))
        lost = lost_owners(vertices, self._skin_of_vertex, count, FARTHEST)
        self._lost.warn(data.time, ~lost)
        first = self.model.skin_vertadr
        trees = {
            k: self._surfaces[k].move(vertices[first[k] : first[k] + self.model.skin_vertnum[k]])
            for k in np.flatnonzero(~lost).tolist()
        }
        self.trees = [surface.tree for surface in self._surfaces]
        position[lost] = np.nan
        return Snapshot(position, np.tile(np.eye(3).reshape(9), (count, 1)), self._shapes(), trees)

    def visible(self, filter: Filter) -> NDArray[np.bool_]:
        model = self.model
        seen = filter.admits(model.skin_group, np.zeros(model.nskin, bool))
        seen &= is_opaque(model, model.skin_rgba, model.skin_matid)
        return seen & ~all_hidden(self._bodies, filter.hidden_bodies(model))

    def _shapes(self) -> Shapes:
        return Shapes.of_trees([solids.TRIANGLES] * self.model.nskin, range(self.model.nskin), self.trees)

    def _bent(self, data: mujoco.MjData, bones: NDArray[np.float64]) -> NDArray[np.float64]:
        """Vertices (nskinvert, 3) as carried by bones at positions (nskinbone, 3), before inflation."""
        model = self.model
        bind = np.array([rotation_matrix(quat) for quat in model.skin_bonebindquat])
        turn = data.xmat[model.skin_bonebodyid].reshape(-1, 3, 3) @ bind.swapaxes(1, 2)
        shift = bones - np.einsum("bij,bj->bi", turn, model.skin_bonebindpos)
        carried = np.einsum("kij,kj->ki", turn[self._bone], model.skin_vert[self._vertex]) + shift[self._bone]
        return _sums(self._vertex, model.skin_bonevertweight[:, None] * carried, model.nskinvert)

    def _inflated(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        inflate = self.model.skin_inflate[self._skin_of_vertex, None]
        if not inflate.any():
            return vertices
        a, b, c = (vertices[self._faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)  # of length twice the face's area, by which faces count
        around = _sums(self._faces.reshape(-1), np.repeat(normal, 3, axis=0), len(vertices))
        length = np.linalg.norm(around, axis=1, keepdims=True)
        return vertices + inflate * around / np.maximum(length, mujoco.mjMINVAL)


def _sums(of: NDArray[np.integer], vectors: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Sums (count, 3): row k is the sum of the vectors (n, 3) whose `of` is k."""
    return np.stack([np.bincount(of, vectors[:, axis], minlength=count) for axis in range(3)], axis=-1)
