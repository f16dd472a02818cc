"""The cameras and rangefinders of a MuJoCo model as sensors."""

from collections.abc import Iterator

import mujoco
import numpy as np

from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.names import usable_name

from .cameras.depth_camera import DepthCamera
from .filter import Filter
from .lidars.lidar import Lidar
from .mount import Mount
from .spec import Integers

_ALONG_Z = (0.0, -90.0, 0.0)  # roll, pitch, yaw [deg] that turn the mount's x axis to where z was


def from_model(model: mujoco.MjModel, resolution: Integers = (640, 480)) -> list[Lidar | DepthCamera]:
    """The cameras and `<rangefinder>`s of a model, as sensors for a `Rig` on it; change them with `model_copy`.

    A camera becomes a depth camera with its optics and its own resolution, or else `resolution` (width, height).
    Orthographic cameras are left out, and cameras without a name, on which nothing can be mounted. A rangefinder on a
    site becomes a lidar of one ray along the site's z axis, shape (1, 1); one on a camera becomes that camera. As in
    MuJoCo, rangefinders do not see the body they are on, which for one fixed to the world is the ground too, and all
    sensors read at every step. A `cutoff` becomes `max_range`, beyond which they read +inf; MuJoCo reads the cutoff
    itself there, and -1 if nothing is hit. Sampling intervals, delays and noise are not taken over.

    Sensors keep their names in the model, with `_` for characters that a sensor's name may not have, and a number where
    two names would be the same.

    Raises InputError for a rangefinder on a body without a name.

    >>> rig = rigcast.Rig(model, rigcast.from_model(model))
    """
    require_type("from_model: model", model, mujoco.MjModel)
    taken: set[str] = set()
    finders = list(_rangefinders(model, taken, resolution))
    watched = {finder.mount.camera for finder in finders}
    names = [model.camera(i).name for i in range(model.ncam)]
    cameras = [i for i, name in enumerate(names) if name and name not in watched and _is_perspective(model, i)]
    return [*(_camera(model, i, usable_name(model.camera(i).name, taken), resolution) for i in cameras), *finders]


def _rangefinders(model: mujoco.MjModel, taken: set[str], resolution: Integers) -> Iterator[Lidar | DepthCamera]:
    for i in np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_RANGEFINDER):
        target, cutoff = int(model.sensor_objid[i]), float(model.sensor_cutoff[i])
        max_range = cutoff if cutoff > 0 else np.inf
        if model.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
            site = model.site(target)
            yield Lidar(
                name=usable_name(model.sensor(i).name or site.name, taken),
                mount=Mount(site=site.name, euler_deg=_ALONG_Z),
                filter=_not_itself(model, int(site.bodyid[0]), f"site {site.name!r}"),
                elevation_deg=[0.0],
                columns=1,
                max_range=max_range,
            )
        elif _is_perspective(model, target):
            camera = model.camera(target)
            own = _not_itself(model, int(camera.bodyid[0]), f"camera {camera.name!r}")
            spec = _camera(model, target, usable_name(model.sensor(i).name or camera.name, taken), resolution)
            yield spec.model_copy(update={"filter": own, "max_range": max_range})


def _camera(model: mujoco.MjModel, index: int, name: str, resolution: Integers) -> DepthCamera:
    own = model.cam_resolution[index].min() > 1
    mount = Mount(camera=model.camera(index).name)
    return DepthCamera(name=name, mount=mount, resolution=None if own else resolution)


def _is_perspective(model: mujoco.MjModel, camera: int) -> bool:
    return bool(model.cam_projection[camera] == mujoco.mjtProjection.mjPROJ_PERSPECTIVE)


def _not_itself(model: mujoco.MjModel, body: int, owner: str) -> Filter:
    name = model.body(body).name
    if not name:
        raise InputError(f"from_model: the rangefinder on {owner} is on body {body}, expected one with a name")
    return Filter(exclude_bodies=[name])
