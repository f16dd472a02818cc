"""Casters of the rays of all worlds, from poses on the device into arrays there."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from rigcast.bench.casters import Answer, Floats
from rigcast.kernels.cast import launch
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.rig.rig import Rig

from .crowd import Crowd

Run = Callable[[], object]


class Rigcast:
    """A rig's `sense` into the frames of its last reading."""

    name = "rigcast"

    def __init__(self, crowd: Crowd, worlds: int, device: wp.Device) -> None:
        self.device, self._poses = device, crowd.on_device(worlds, device)
        self._rig = Rig(crowd.workload.model, [crowd.lidar], device)
        self._frames = self._rig.sense(self._poses)
        self._frame = self._frames["lidar"]
        self.sense()

    @cached_property
    def _with_points(self) -> dict[str, Frame]:
        """Frames whose points are computed by every reading, because they have been requested."""
        frames = self._rig.sense(self._poses)
        _ = frames["lidar"].points
        return frames

    def sense(self) -> None:
        """Update poses, aim the sensor, cast all rays and make readings."""
        self._rig.sense(self._poses, out=self._frames)

    def sense_points(self) -> None:
        """`sense`, and points in the sensor's frame."""
        self._rig.sense(self._poses, out=self._with_points)

    def update(self) -> None:
        """Only the update: the trees over the geoms of every world."""
        self._rig.scene.update(self._poses)

    def cast(self) -> None:
        """Only the cast and readings, at the poses of the last update."""
        assert self._frame._arrays.cast is not None
        launch([self._frame._arrays.cast])

    def answer(self) -> Answer:
        """Hits of the last cast, world after world."""
        frame = self._frame
        return Answer(frame.range.numpy().ravel(), frame.geom_id.numpy().ravel(), frame.normal.numpy().reshape(-1, 3))

    def poses(self) -> Floats:
        """The sensor's poses (nworld, 4, 4)."""
        poses: Any = self._frame.pose
        return np.asarray(poses.numpy())


class MujocoWarp:
    """mujoco_warp's `rays` with its BVH, given rays in the world. Raises ImportError if it is not installed."""

    name = "mujoco_warp"

    def __init__(self, crowd: Crowd, worlds: int, device: wp.Device, poses: Floats) -> None:
        import mujoco_warp as mjw

        from rigcast.bench.casters.with_mujoco_warp import Rays  # imported here, because it imports mujoco_warp

        self.device, self._mjw, model = device, mjw, crowd.workload.model
        directions = crowd.directions @ poses[:, :3, :3].transpose(0, 2, 1)
        origins = np.broadcast_to(poses[:, None, :3, 3], directions.shape)
        with wp.ScopedDevice(device):
            self._model = mjw.put_model(model)
            self._state = mjw.make_data(model, nworld=worlds, nconmax=1, njmax=1)
            for name, array in crowd.on_device(worlds, device).items():
                setattr(self._state, name, array)
            self._context: Any = mjw.create_render_context(
                model, nworld=worlds, enabled_geom_groups=list(crowd.workload.groups), cam_active=[]
            )
            self._rays = Rays(origins, directions)
        self.frame()

    def frame(self) -> None:
        """Refit the trees over the geoms of every world, and cast all rays."""
        with wp.ScopedDevice(self.device):
            self._mjw.refit_bvh(self._model, self._state, self._context)
        self.cast()

    def cast(self) -> None:
        """Only cast all rays."""
        with wp.ScopedDevice(self.device):
            self._rays.cast(self._model, self._state, self._context)

    def answer(self) -> Answer:
        """Hits of the last cast, world after world."""
        return self._rays.answer()


def captured(run: Run, device: wp.Device) -> Run:
    """Return a function that replays a run as a CUDA graph."""
    with wp.ScopedCapture(device) as capture:
        run()
    return lambda: wp.capture_launch(capture.graph)
