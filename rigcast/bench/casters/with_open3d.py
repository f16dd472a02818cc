"""Embree, through Open3D's `RaycastingScene`: one mesh of all triangles in the world, which do not move.

Closed forms are cut into triangles with their corners on the surface, so its hits on round shapes are a little deeper.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
import open3d

from rigcast.kernels.launching.slices import thread_count

from .caster import EVERY_GROUP, Answer, Cast, Floats
from .tessellation import merged_triangles


class Embree:
    name = "Open3D"
    version = open3d.__version__

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int] = EVERY_GROUP) -> None:
        vertices, faces, geom_of_face = merged_triangles(model, data, groups)
        self._geom_of_face = np.append(geom_of_face, -1)  # the last one is that of a miss
        self._scene = open3d.t.geometry.RaycastingScene(nthreads=thread_count())
        self._scene.add_triangles(vertices, faces)

    def aim(self, origins: Floats, directions: Floats) -> Cast:
        starts = np.broadcast_to(origins, directions.shape)
        rays = open3d.core.Tensor(np.concatenate([starts, directions], axis=1).astype(np.float32))

        def frame() -> Answer:
            hits = self._scene.cast_rays(rays, nthreads=thread_count())
            face = np.minimum(hits["primitive_ids"].numpy(), len(self._geom_of_face) - 1)
            geom_id = self._geom_of_face[face]
            return Answer(hits["t_hit"].numpy(), geom_id, hits["primitive_normals"].numpy())

        return frame


CASTER = Embree
