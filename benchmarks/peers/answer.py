"""What a caster answers, and the list of casters."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Answer:
    """What n rays hit: distance (n,) [m], +inf on a miss; geom_id (n,) and outward normal (n, 3), or None where
    the caster does not report them. geom_id counts on to flexes, skins and props as `rigcast.oracle.Things` does."""

    distance: Floats
    geom_id: npt.NDArray[np.int32] | None
    normal: Floats | None


@dataclass(frozen=True)
class Caster:
    """A caster by name and version. cast(model, data, origins, directions): origins (n, 3) [m] and unit directions
    (n, 3) in the world frame, poses as they stand in data."""

    name: str
    version: str
    cast: Callable[[mujoco.MjModel, mujoco.MjData, Floats, Floats], Answer]


MODULES = ("with_rigcast", "with_multi_ray", "with_mujoco_lidar", "with_mujoco_warp")


def load_casters() -> tuple[list[Caster], list[str]]:
    """Return the casters that can be run here, rigcast first, and a line about each that cannot."""
    casters, missing = [], []
    for name in MODULES:
        try:
            casters.append(importlib.import_module(f"peers.{name}").CASTER)
        except ImportError as error:
            missing.append(f"{name.removeprefix('with_')} could not be imported here: {error}")
    return casters, missing
