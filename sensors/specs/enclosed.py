"""Detection of sensors inside or on a geom of their own body, which hides everything else."""

from collections.abc import Iterable, Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.meshes import mesh_of_model

from .sensor_spec import SensorSpec

_GEOM = mujoco.mjtGeom
_MARGIN = 1e-6  # [m] from a surface, where rays start on it: they hit it at 0, for mj_ray as well


def enclosed(model: mujoco.MjModel, data: mujoco.MjData, sensors: Iterable[SensorSpec]) -> Iterator[str]:
    """A warning for each sensor whose rays begin inside or on a geom that they can hit and that moves with the sensor.

    Their relative pose never changes, so any poses in `data` will do.
    """
    for sensor in sensors:
        geom = _geom_around(model, data, sensor)
        if geom is not None:
            body = int(model.geom_bodyid[geom])
            name, of_body = model.geom(geom).name, model.body(body).name
            remedy = f"exclude_bodies: [{of_body}]" if of_body else "geom_groups"  # only names can be excluded
            yield (
                f"sensor {sensor.name!r} is within geom {name or geom!r} of body {of_body or body!r} or on its "
                f"surface, which hides from it what is outside; {remedy} in its filter leaves that out"
            )


def _geom_around(model: mujoco.MjModel, data: mujoco.MjData, sensor: SensorSpec) -> int | None:
    mount = sensor.mount.bind(model)
    position = mount.pose(data)[:3, 3]
    own = np.flatnonzero(sensor.filter.visible(model) & _moving_with(model, mount.body_id)[model.geom_bodyid])
    for geom in own.tolist():
        if _contains(model, geom, data.geom_xmat[geom].reshape(3, 3).T @ (position - data.geom_xpos[geom])):
            return geom
    return None


def _moving_with(model: mujoco.MjModel, body: int) -> NDArray[np.bool_]:
    """Which bodies (nbody,) are fixed to a body; if that is fixed to the world, perhaps a room, only itself."""
    weld = model.body_weldid
    if weld[body]:
        return np.asarray(weld == weld[body])
    return np.asarray((np.arange(model.nbody) == body) & (body != 0))


def _contains(model: mujoco.MjModel, geom: int, point: NDArray[np.float64]) -> bool:
    """Whether a point (3,) [m] in the geom's frame is inside the geom or on its surface."""
    size, away = model.geom_size[geom] + _MARGIN, np.abs(point)
    match model.geom_type[geom]:
        case _GEOM.mjGEOM_SPHERE:
            return bool(np.linalg.norm(point) < size[0])
        case _GEOM.mjGEOM_CAPSULE:
            return bool(np.hypot(np.linalg.norm(point[:2]), max(0.0, away[2] - model.geom_size[geom, 1])) < size[0])
        case _GEOM.mjGEOM_ELLIPSOID:
            return bool(np.linalg.norm(point / size) < 1.0)
        case _GEOM.mjGEOM_CYLINDER:
            return bool(np.linalg.norm(point[:2]) < size[0] and away[2] < size[1])
        case _GEOM.mjGEOM_BOX:
            return bool((away < size).all())
        case _GEOM.mjGEOM_MESH:
            return _is_in_box(model.geom_aabb[geom], point) and _mesh_contains(model, geom, point)
    return False


def _is_in_box(box: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
    return bool((np.abs(point - box[:3]) <= box[3:] + _MARGIN).all())


def _mesh_contains(model: mujoco.MjModel, geom: int, point: NDArray[np.float64]) -> bool:
    vertices, faces = mesh_of_model(model, model.geom_dataid[geom])
    corners = vertices[faces].astype(np.float64)
    return _is_on_surface(corners, point) or _turns_around(corners, point) > 0.5


def _is_on_surface(corners: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
    """Whether one of the faces (n, 3, 3) is within the margin of a point."""
    low, high = corners.min(1) - _MARGIN, corners.max(1) + _MARGIN
    near = corners[((low <= point) & (point <= high)).all(1)]
    if not len(near):
        return False
    import trimesh  # imported here, because few sensors are so close to a mesh

    nearest = trimesh.triangles.closest_point(near, np.broadcast_to(point, (len(near), 3)))
    return bool((np.linalg.norm(nearest - point, axis=1) <= _MARGIN).any())


def _turns_around(corners: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    """Winding number of faces (n, 3, 3) about a point: their solid angles over 4 pi; 1 inside a closed mesh, else 0.

    For a face a, b, c relative to the point, tan(angle / 2) = a . (b x c) / (|a||b||c| + a.b |c| + b.c |a| + c.a |b|)
    (van Oosterom and Strackee, 1983).
    """
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = (a * np.cross(b, c)).sum(1)
    about = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(volume, about).sum() / (2 * np.pi))
