"""Height scans: the ground under a robot, sampled on a grid of parallel rays."""

from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator

from .mount import Alignment
from .pattern import MOST_RAYS, Pattern
from .sensor_spec import SensorSpec
from .spec import Numbers, Takes

_Length = Annotated[float, Field(gt=0)]


class HeightScan(SensorSpec):
    """Parallel rays down from a grid around the mount. Readings have shape (rays,).

    The grid has floor(size / spacing) + 1 points along each axis, centred on the mount and at its height. The points
    are ordered along x first, then along y, both ascending.

    Alignment: with `yaw` the grid follows the mount's yaw and ignores its roll and pitch; with `world` its axes are the
    world's. In both the rays go straight down, along the world's -z, and range is the height of the mount above what is
    below the ray. With `base` grid and rays are fixed to the mount: the rays go along its -z, and range is the distance
    along them. `points_world` has the height of the ground in the world, whatever the alignment. The grid's centre
    always follows the mount.

    >>> HeightScan(name="feet", mount=Mount(body="torso"), size=(1.6, 1.0), spacing=0.1)
    """

    type: Literal["height_scan"] = "height_scan"
    size: Takes[Numbers, tuple[_Length, _Length]] = Field(description="extent of the grid along x and y [m]")
    spacing: float = Field(gt=0, description="distance between neighbouring rays [m]")
    alignment: Alignment = Field(
        default="yaw",
        description="what of the mount's rotation grid and rays follow; base: all, yaw: its yaw only, world: nothing",
    )

    @field_validator("spacing")
    @classmethod
    def _not_too_many(cls, spacing: float, info: ValidationInfo) -> float:
        across, along = info.data.get("size", (0.0, 0.0))
        rays = (across / spacing + 1) * (along / spacing + 1)
        if rays > MOST_RAYS:
            raise ValueError(f"makes {rays:.3g} rays of size {across:g} x {along:g} m, expected at most {MOST_RAYS}")
        return spacing

    @property
    def frame_alignment(self) -> Alignment:
        """What the sensor's frame keeps of the mount's rotation: `alignment`."""
        return self.alignment

    def pattern(self, model: mujoco.MjModel) -> Pattern:  # noqa: ARG002
        """Directions (rays, 3), all (0, 0, -1), and origins (rays, 3) [m] in the aligned frame."""
        x, y = (self._axis(length) for length in self.size)
        grid = np.zeros((len(y), len(x), 3))
        grid[..., 0], grid[..., 1] = x, y[:, None]
        origins = grid.reshape(-1, 3)
        return Pattern(np.tile([0.0, 0.0, -1.0], (len(origins), 1)), origins=origins)

    def _axis(self, length: float) -> NDArray[np.float64]:
        # 1.6 / 0.1 is 16 only up to rounding; a part in 1e9 of the spacing makes it so.
        count = int(length / self.spacing + 1e-9) + 1
        return self.spacing * (np.arange(count, dtype=np.float64) - (count - 1) / 2)
