"""MuJoCo's `mj_ray`, ray by ray: the reference, called from Python."""

from collections.abc import Sequence

import mujoco

from rigcast.oracle import Oracle
from rigcast.sensors.specs.filter import Filter

from .caster import EVERY_GROUP, Answer, Cast, Floats


class MjRay:
    name = "mj_ray"
    version = mujoco.__version__

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int] = EVERY_GROUP) -> None:
        self.oracle = Oracle(model, data, Filter(geom_groups=tuple(groups)))

    def aim(self, origins: Floats, directions: Floats) -> Cast:
        return lambda: Answer(*self.oracle.cast(origins, directions))


CASTER = MjRay
