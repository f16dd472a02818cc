"""Depth cameras at the world's origin that look along +x at a few geoms."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from small_scenes import model_of

from rigcast import CameraFrame, DepthCamera, Mount, Rig

WIDTH, HEIGHT = 400, 300  # 1.2e5 pixels
FOCAL = 400.0
OPTICS = {"fx": FOCAL, "fy": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2}
WALL = '<geom name="wall" type="plane" size="0 0 1" zaxis="-1 0 0" pos="{} 0 0"/>'


def camera(**arguments: Any) -> DepthCamera:
    """A camera of WIDTH x HEIGHT pixels with focal length FOCAL, unless the arguments say otherwise."""
    optics = {} if "fov_y_deg" in arguments else OPTICS
    return DepthCamera(**{"name": "eye", "mount": Mount(), "resolution": (WIDTH, HEIGHT), **optics, **arguments})


def rig(worldbody: str, *cameras: DepthCamera, seed: int = 0) -> Rig:
    return Rig(model_of(worldbody), cameras, "cpu", seed)


def look(worldbody: str, spec: DepthCamera, seed: int = 0) -> CameraFrame:
    """The first frame of one camera."""
    watching = rig(worldbody, spec, seed=seed)
    frame = watching.sense(mujoco.MjData(watching.model))[spec.name]
    assert isinstance(frame, CameraFrame)
    return frame


def depth_of(worldbody: str, seed: int = 0, **arguments: Any) -> NDArray[np.float64]:
    """The depth (H, W) [m] that a camera with these arguments measures."""
    return look(worldbody, camera(**arguments), seed).depth.numpy().astype(np.float64)


def columns() -> NDArray[np.float64]:
    """(WIDTH,) horizontal coordinates [pixels] of the pixels' centres."""
    return np.arange(WIDTH, dtype=np.float64) + 0.5
