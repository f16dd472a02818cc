"""Ray-cast lidars and depth cameras for MuJoCo, on CPU and CUDA, checked against mj_ray."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .config import load_rig as load_rig
    from .overlay import overlay as overlay
    from .sensors.errors import InputError as InputError
    from .sensors.rig.frame import CameraFrame as CameraFrame
    from .sensors.rig.frame import Frame as Frame
    from .sensors.rig.frame import LidarFrame as LidarFrame
    from .sensors.rig.rig import Rig as Rig
    from .sensors.scene.hits import Hits as Hits
    from .sensors.scene.scene import Scene as Scene
    from .sensors.specs.depth_camera import DepthCamera as DepthCamera
    from .sensors.specs.filter import Filter as Filter
    from .sensors.specs.height_scan import HeightScan as HeightScan
    from .sensors.specs.imported import from_model as from_model
    from .sensors.specs.lidar import Lidar as Lidar
    from .sensors.specs.mount import Mount as Mount
    from .sensors.specs.prop import Prop as Prop

    __version__: str

_HOME = {
    "CameraFrame": "sensors.rig.frame",
    "DepthCamera": "sensors.specs.depth_camera",
    "Filter": "sensors.specs.filter",
    "Frame": "sensors.rig.frame",
    "HeightScan": "sensors.specs.height_scan",
    "Hits": "sensors.scene.hits",
    "InputError": "sensors.errors",
    "Lidar": "sensors.specs.lidar",
    "LidarFrame": "sensors.rig.frame",
    "Mount": "sensors.specs.mount",
    "Prop": "sensors.specs.prop",
    "Rig": "sensors.rig.rig",
    "Scene": "sensors.scene.scene",
    "from_model": "sensors.specs.imported",
    "load_rig": "config",
    "overlay": "overlay",
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
