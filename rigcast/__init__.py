"""Ray-cast lidars and depth cameras for MuJoCo, on CPU and CUDA, checked against mj_ray.

    rig = rigcast.load_rig("rig.yaml")      or rigcast.Rig(model, [rigcast.Lidar(...), ...])
    frames = rig.sense(data)                a frame of each sensor now, by name; also for many worlds
    for frame in rig.step(data): ...        after each mj_step, the frames that fell due
    frame.range.numpy()                     or torch.from_dlpack(frame.range)

`Lidar`, `DepthCamera` and `HeightScan` say what a sensor is, `Mount` where it is, `Filter` what its rays may hit;
`Frame` has its readings. Below a rig is a `Scene`, which casts any rays. Invalid input raises `InputError`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .collector import paused_collector

if TYPE_CHECKING:
    from .checking import check as check
    from .dataset.reading import open_dataset as open_dataset
    from .export.options import Export as Export
    from .recording.recorder import Recorder as Recorder
    from .rig_file import load_rig as load_rig
    from .ros.node import RosNode as RosNode
    from .sensors.errors import InputError as InputError
    from .sensors.rig.frame import CameraFrame as CameraFrame
    from .sensors.rig.frame import Frame as Frame
    from .sensors.rig.frame import LidarFrame as LidarFrame
    from .sensors.rig.rig import Rig as Rig
    from .sensors.scene.batch.worlds import Worlds as Worlds
    from .sensors.scene.hits import Hits as Hits
    from .sensors.scene.scene import Scene as Scene
    from .sensors.specs.cameras.depth_camera import DepthCamera as DepthCamera
    from .sensors.specs.cameras.ranging import Stereo as Stereo
    from .sensors.specs.cameras.ranging import TimeOfFlight as TimeOfFlight
    from .sensors.specs.filter import Filter as Filter
    from .sensors.specs.height_scan import HeightScan as HeightScan
    from .sensors.specs.imported import from_model as from_model
    from .sensors.specs.lens import BrownConrady as BrownConrady
    from .sensors.specs.lens import KannalaBrandt as KannalaBrandt
    from .sensors.specs.lidars.effects import Beam as Beam
    from .sensors.specs.lidars.effects import Detection as Detection
    from .sensors.specs.lidars.effects import Noise as Noise
    from .sensors.specs.lidars.effects import Weather as Weather
    from .sensors.specs.lidars.lidar import Lidar as Lidar
    from .sensors.specs.mount import Mount as Mount
    from .sensors.specs.prop import Prop as Prop
    from .sensors.specs.surface import Surface as Surface
    from .sensors.threads import set_threads as set_threads
    from .view.in_viewer import overlay as overlay

    __version__: str

# Each of these packages imports only from those above it:
#     export, oracle, motion               files of frames; the judge of casts; steps of a simulation
#     rig_file, ros                        rigs from YAML; messages, bags and a node of ROS
#     recording, bench                     folders of runs; measurements
#     dataset                              runs of a rig in many scenes
#     view, cli                            looking at what was written; the command line

_HOME = {
    "Beam": "sensors.specs.lidars.effects",
    "BrownConrady": "sensors.specs.lens",
    "CameraFrame": "sensors.rig.frame",
    "DepthCamera": "sensors.specs.cameras.depth_camera",
    "Detection": "sensors.specs.lidars.effects",
    "Export": "export.options",
    "Filter": "sensors.specs.filter",
    "Frame": "sensors.rig.frame",
    "HeightScan": "sensors.specs.height_scan",
    "Hits": "sensors.scene.hits",
    "InputError": "sensors.errors",
    "KannalaBrandt": "sensors.specs.lens",
    "Lidar": "sensors.specs.lidars.lidar",
    "LidarFrame": "sensors.rig.frame",
    "Mount": "sensors.specs.mount",
    "Noise": "sensors.specs.lidars.effects",
    "Prop": "sensors.specs.prop",
    "Recorder": "recording.recorder",
    "Rig": "sensors.rig.rig",
    "RosNode": "ros.node",
    "Scene": "sensors.scene.scene",
    "Stereo": "sensors.specs.cameras.ranging",
    "Surface": "sensors.specs.surface",
    "TimeOfFlight": "sensors.specs.cameras.ranging",
    "Weather": "sensors.specs.lidars.effects",
    "Worlds": "sensors.scene.batch.worlds",
    "check": "checking",
    "from_model": "sensors.specs.imported",
    "load_rig": "rig_file",
    "open_dataset": "dataset.reading",
    "overlay": "view.in_viewer",
    "set_threads": "sensors.threads",
}

__all__ = list(_HOME)


if not TYPE_CHECKING:  # which would have every name by it

    def __getattr__(name: str) -> Any:
        # on first use: the command line starts without waiting for Warp
        if name == "__version__":
            return import_module("importlib.metadata").version("rigcast")
        if name not in _HOME:
            raise AttributeError(f"module 'rigcast' has no attribute {name!r}")
        with paused_collector():
            value = getattr(import_module(f"rigcast.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
