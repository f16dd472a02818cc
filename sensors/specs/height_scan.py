"""Height scans: the ground under a robot, sampled on a grid that turns with it but does not tilt."""

from typing import Annotated, ClassVar, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator

from .pattern import MOST_RAYS, Pattern
from .sensor_spec import SensorSpec
from .spec import Numbers, Takes

_Length = Annotated[float, Field(gt=0)]


class HeightScan(SensorSpec):
    """Parallel rays straight down (world -z) from a grid around the mount. Readings have shape (rays,).

    The grid has floor(size / spacing) + 1 points along each axis, centred on the mount and at its height. It follows
    the mount's yaw and ignores its roll and pitch. The points are ordered along x first, then along y, both ascending.
    Range is the height of the mount above what is below it.

    >>> HeightScan(name="feet", mount=Mount(body="torso"), size=(1.6, 1.0), spacing=0.1)
    """

    yaw_aligned: ClassVar[bool] = True

    type: Literal["height_scan"] = "height_scan"
    size: Takes[Numbers, tuple[_Length, _Length]] = Field(description="extent of the grid along x and y [m]")
    spacing: float = Field(gt=0, description="distance between neighbouring rays [m]")

    @field_validator("spacing")
    @classmethod
    def _not_too_many(cls, spacing: float, info: ValidationInfo) -> float:
        across, along = info.data.get("size", (0.0, 0.0))
        rays = (across / spacing + 1) * (along / spacing + 1)
        if rays > MOST_RAYS:
            raise ValueError(f"makes {rays:.3g} rays of size {across:g} x {along:g} m, expected at most {MOST_RAYS}")
        return spacing

    def pattern(self, model: mujoco.MjModel) -> Pattern:  # noqa: ARG002
        """Directions (rays, 3), all (0, 0, -1), and origins (rays, 3) [m] in the yaw-aligned frame."""
        x, y = (self._axis(length) for length in self.size)
        grid = np.zeros((len(y), len(x), 3))
        grid[..., 0], grid[..., 1] = x, y[:, None]
        origins = grid.reshape(-1, 3)
        return Pattern(np.tile([0.0, 0.0, -1.0], (len(origins), 1)), origins=origins)

    def _axis(self, length: float) -> NDArray[np.float64]:
        # 1.6 / 0.1 is 16 only up to rounding; a part in 1e9 of the spacing makes it so.
        count = int(length / self.spacing + 1e-9) + 1
        return self.spacing * (np.arange(count, dtype=np.float64) - (count - 1) / 2)


def yaw_only(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) pose with the position and yaw of `pose`, and z upright.

    The yaw is the heading of the x axis, atan2(R10, R00); it is 0 for an x axis that is exactly vertical.
    """
    x, y = pose[0, 0], pose[1, 0]
    # by square roots alone, as in rigcast.kernels.poses.mounts, so that both have the same bits
    length = np.sqrt(x * x + y * y)
    cosine, sine = (x / length, y / length) if length != 0 else (np.float64(1.0), np.float64(0.0))
    upright = pose.copy()
    upright[:3, :3] = [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]
    return upright
