"""Mounts in many worlds, on a device."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.poses.mounts import Attachment
from rigcast.sensors.specs.mount import BoundMount, Parent


@dataclass(frozen=True, eq=False)
class WorldMounts:
    """The mounts of a sensor or prop on carriers of one kind: carrier `which`, (1,) or (nworld,), and pose on it."""

    kind: Parent
    which: NDArray[np.int32]
    on: Attachment

    def of_worlds(self, part: slice) -> "WorldMounts":
        """The mounts in some of the worlds."""
        if self.which.size == 1:
            return self
        return WorldMounts(self.kind, self.which[part], self.on.of_worlds(part))

    @staticmethod
    def by(mounts: Sequence[BoundMount], device: wp.Device) -> "WorldMounts":
        """Make it from one mount, or from one per world, all on carriers of one kind."""
        which = np.array([mount.id for mount in mounts], np.int32)
        offsets = np.array([mount.offset for mount in mounts])
        return WorldMounts(mounts[0].parent, which, Attachment.of(which, offsets, device))
