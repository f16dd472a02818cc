"""A model as one mesh in the world, for casters that support triangles only."""

from collections.abc import Sequence

import mujoco
import numpy as np
import numpy.typing as npt
import trimesh

from rigcast.sensors.meshes import mesh_of_model
from rigcast.sensors.scene.parts.height_fields import hfield_data, hfield_triangles

SECTIONS = 32
"""Corners around a round shape; its triangles are at most (1 - cos(pi / 32)) r = 0.005 r inside it."""
FAR = 1000.0
"""Half size [m] of an unbounded plane."""

Triangles = tuple[npt.NDArray[np.float64], npt.NDArray[np.integer]]
_GEOM = mujoco.mjtGeom


def merged_triangles(
    model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32], npt.NDArray[np.int32]]:
    """Return vertices (n, 3) [m] in the world, faces (m, 3) and each face's geom: what rays can hit in `groups`."""
    vertices, faces, geoms, first = [], [], [], 0
    material = model.geom_matid
    alpha = np.where(material >= 0, model.mat_rgba[material, 3] if model.nmat else 1.0, model.geom_rgba[:, 3])
    for geom in np.flatnonzero((alpha > 0) & np.isin(model.geom_group, groups)):
        local, of_geom = _triangles(model, int(geom))
        vertices.append(local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
        faces.append(of_geom + first)
        geoms.append(np.full(len(of_geom), geom, np.int32))
        first += len(local)
    return np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.uint32), np.concatenate(geoms)


def _triangles(model: mujoco.MjModel, geom: int) -> Triangles:
    """Return vertices and faces in the geom's own frame."""
    kind, size, asset = _GEOM(model.geom_type[geom]), model.geom_size[geom], model.geom_dataid[geom]
    if kind == _GEOM.mjGEOM_HFIELD:
        return hfield_triangles(model.hfield_size[asset], hfield_data(model, asset))
    if kind in (_GEOM.mjGEOM_MESH, _GEOM.mjGEOM_SDF):
        vertices, faces = mesh_of_model(model, asset)
        return vertices.astype(np.float64), faces
    if kind == _GEOM.mjGEOM_PLANE:
        x, y = np.where(size[:2] > 0, size[:2], FAR)
        return np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    mesh = _solid(kind, size)
    mesh.update_faces(mesh.nondegenerate_faces())  # those at the poles
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)


def _solid(kind: mujoco.mjtGeom, size: npt.NDArray[np.float64]) -> trimesh.Trimesh:
    if kind == _GEOM.mjGEOM_BOX:
        return trimesh.creation.box(extents=2 * size)
    if kind == _GEOM.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=SECTIONS)
    if kind == _GEOM.mjGEOM_CAPSULE:
        capsule = trimesh.creation.capsule(radius=size[0], height=2 * size[1], count=[SECTIONS, SECTIONS])
        capsule.apply_translation(-capsule.bounds.mean(axis=0))
        return capsule
    ball = trimesh.creation.uv_sphere(radius=1.0, count=[SECTIONS, SECTIONS])
    ball.apply_scale(size if kind == _GEOM.mjGEOM_ELLIPSOID else size[0])
    return ball
