"""mj_ray on props: a MuJoCo model of their meshes, at the poses of their mounts."""

from collections.abc import Sequence

import mujoco
import numpy as np

from rigcast.oracle.ray import Floats, Oracle
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop


def props_oracle(model: mujoco.MjModel, data: mujoco.MjData, filter: Filter, props: Sequence[Prop]) -> Oracle:
    """Return mj_ray over the props on `model` in a state of it; geom k is prop k."""
    meshes = _compiled(props)
    placed = mujoco.MjData(meshes)
    mujoco.mj_kinematics(meshes, placed)
    hidden = filter.hidden_bodies(model)
    for k, prop in enumerate(props):
        mount = prop.mount.bind(model)
        _move(placed, k, mount.pose(data))
        meshes.geom_rgba[k, 3] = 0 if hidden[mount.body_id] else 1
    return Oracle(meshes, placed)


def _compiled(props: Sequence[Prop]) -> mujoco.MjModel:
    """Return a model of one mesh geom for each prop, as if all were mounted at the origin.

    MuJoCo moves a mesh into a frame of its own, which the geom's pose makes up for. As shells meshes need not be
    closed, nor have a volume.
    """
    spec = mujoco.MjSpec()
    names = {(prop.file, prop.scale): prop.name for prop in reversed(props)}
    for prop in props:
        name = names[prop.file, prop.scale]
        if name == prop.name:
            vertices, faces = prop.triangles()
            # MuJoCo requires four vertices; an unused one is harmless
            vertices = np.concatenate([vertices, vertices.mean(axis=0, keepdims=True)])
            mesh = spec.add_mesh(name=name, uservert=vertices.ravel(), userface=faces.ravel().astype(np.int32))
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0)
    return spec.compile()


def _move(data: mujoco.MjData, geom: int, pose: Floats) -> None:
    data.geom_xpos[geom] = pose[:3, :3] @ data.geom_xpos[geom] + pose[:3, 3]
    data.geom_xmat[geom] = (pose[:3, :3] @ data.geom_xmat[geom].reshape(3, 3)).ravel()
