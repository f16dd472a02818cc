"""Ray-cast lidars and depth cameras for MuJoCo, on CPU and CUDA, checked against mj_ray."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .config import load_rig as load_rig
    from .sensors.depth_camera import DepthCamera as DepthCamera
    from .sensors.errors import InputError as InputError
    from .sensors.filter import Filter as Filter
    from .sensors.frame import CameraFrame as CameraFrame
    from .sensors.frame import Frame as Frame
    from .sensors.frame import LidarFrame as LidarFrame
    from .sensors.height_scan import HeightScan as HeightScan
    from .sensors.hits import Hits as Hits
    from .sensors.lidar import Lidar as Lidar
    from .sensors.mount import Mount as Mount
    from .sensors.prop import Prop as Prop
    from .sensors.rig import Rig as Rig
    from .sensors.scene import Scene as Scene

    __version__: str

_HOME = {
    "CameraFrame": "sensors.frame",
    "DepthCamera": "sensors.depth_camera",
    "Filter": "sensors.filter",
    "Frame": "sensors.frame",
    "HeightScan": "sensors.height_scan",
    "Hits": "sensors.hits",
    "InputError": "sensors.errors",
    "Lidar": "sensors.lidar",
    "LidarFrame": "sensors.frame",
    "Mount": "sensors.mount",
    "Prop": "sensors.prop",
    "Rig": "sensors.rig",
    "Scene": "sensors.scene",
    "load_rig": "config",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    # on first use: the command line starts without waiting for Warp
    if name == "__version__":
        return import_module("importlib.metadata").version("rigcast")
    if name not in _HOME:
        raise AttributeError(f"module 'rigcast' has no attribute {name!r}")
    value = getattr(import_module(f"rigcast.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
