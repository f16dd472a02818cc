"""The interface of casters, and the list of casters."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of

Floats = npt.NDArray[np.float64]
EVERY_GROUP = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Answer:
    """Hits of n rays: distance (n,) [m], +inf on a miss; geom_id (n,) and outward normal (n, 3), or None if
    the caster does not report them. geom_id continues to flexes, skins and props as in `rigcast.oracle.Things`."""

    distance: npt.NDArray[np.floating]
    geom_id: npt.NDArray[np.integer] | None
    normal: npt.NDArray[np.floating] | None


Cast = Callable[[], Answer]


class Caster(Protocol):
    """A caster with what it builds once for a model: the geoms of these groups, in the poses of `data` as they stand.

    name, version: of the caster.
    """

    name: str
    version: str

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, groups: Sequence[int] = EVERY_GROUP) -> None: ...

    def aim(self, origins: Floats, directions: Floats) -> Cast:
        """A function that casts these rays each time it is called: updates poses, casts, returns hits as numpy.

        origins (3,) for all rays or (n, 3) [m], unit directions (n, 3), in the world. Preparation that can be done once
        for rays that stay the same is done here.
        """
        ...


_MODULES = {
    "rigcast": "with_rigcast",
    "Open3D": "with_open3d",
    "mj_multiRay": "with_multi_ray",
    "mj_ray": "with_mj_ray",
    "MuJoCo-LiDAR": "with_mujoco_lidar",
    "mujoco_warp": "with_mujoco_warp",
}
CASTERS = tuple(_MODULES)


def load_casters(names: Sequence[str]) -> tuple[list[type[Caster]], list[str]]:
    """Return the casters of these names that can run here, and a line about each one that cannot.

    Raises:
        InputError: there is no caster of one of these names.
    """
    casters, missing = [], []
    for name in names:
        if name not in _MODULES:
            raise InputError(f"no caster {name!r}, {expected_one_of(name, CASTERS)}")
        try:
            casters.append(import_module(f".{_MODULES[name]}", __package__).CASTER)
        except ImportError as error:
            missing.append(f"{name}: {error}; pip install 'rigcast[benchmark]' brings it")
    return casters, missing
