"""The launches of a sensor's readings, prepared once and reused."""

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import Readings
from rigcast.kernels.host.poses import PlacedFrame
from rigcast.kernels.rays.arrays import Rays
from rigcast.sensors.scene.stage import Stage
from rigcast.sensors.specs.mount import Alignment, BoundMount


class Launches:
    """The launches that compute one sensor's pose, and that cast and read its rays without errors.

    Preparing a cast takes longer than a small frame, so it is repeated only when the arguments change.
    """

    def __init__(self) -> None:
        self._frame: PlacedFrame | None = None
        self._readings: Readings | None = None
        self._prepared_for: tuple[object, wp.array | None, int] = (None, None, 0)

    def place(
        self, mount: BoundMount, alignment: Alignment, data: mujoco.MjData, device: wp.Device
    ) -> tuple[NDArray[np.float64], PlacedFrame]:
        """The pose (4, 4) of the sensor on its mount in `data`, and the same on the device until the next call."""
        if self._frame is None:
            self._frame = PlacedFrame(mount.id, mount.offset, alignment, device)
        return self._frame.place(*mount.carriers(data)), self._frame

    def prepared(
        self, scene: Stage, fixed: object, rays: Rays, visible: wp.array, limits: tuple[float, float]
    ) -> Readings:
        """A cast of these rays within these limits [m]; call its `turn_to` with the rays' pose and the output arrays.

        fixed: the part of the rays that does not depend on the sensor's pose.
        """
        known = self._prepared_for
        if self._readings is None or fixed is not known[0] or visible is not known[1] or rays.worlds != known[2]:
            self._readings = scene.prepare_readings(rays, visible, limits)
            self._prepared_for = fixed, visible, rays.worlds
        return self._readings
