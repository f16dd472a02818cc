"""Scenes with known echoes, and one reading of a lidar in them."""

from typing import Any

import mujoco

from rigcast import Lidar, LidarFrame, Mount, Rig

ROWS, COLUMNS = 256, 400
SEED = 3


def bubble(radius: float, grey: float = 0.5) -> str:
    """A sphere around the origin: every ray from there hits it at a distance `radius` and at right angles."""
    return f'<geom name="bubble" size="{radius}" rgba="{grey} {grey} {grey} 1"/>'


def wall(name: str, x: float, rgba: str = "0.5 0.5 0.5 1", more: str = "") -> str:
    """An upright plane at x that faces the origin."""
    return f'<geom name="{name}" type="plane" size="0 0 1" zaxis="-1 0 0" pos="{x} 0 0" rgba="{rgba}" {more}/>'


def model_of(worldbody: str, asset: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco><asset>{asset}</asset><worldbody>{worldbody}</worldbody></mujoco>")


def wide(**options: Any) -> Lidar:
    """102 400 rays over a sector ahead, unless the options say otherwise."""
    pattern = {
        "elevation_deg": [0.1 * (k - ROWS / 2) for k in range(ROWS)],
        "columns": COLUMNS,
        "azimuth_deg": (-40, 40),
    }
    return Lidar(**{"name": "top", "mount": Mount(), **pattern, **options})


def ahead(**options: Any) -> Lidar:
    """One ray along +x."""
    return wide(**{"elevation_deg": [0], "columns": 1, "azimuth_deg": None, **options})


def sense(model: mujoco.MjModel, *lidars: Lidar, seed: int = SEED, **rig: Any) -> LidarFrame:
    """The first reading of the first lidar."""
    frame = Rig(model, lidars, seed=seed, **rig).sense(mujoco.MjData(model))[lidars[0].name]
    assert isinstance(frame, LidarFrame)
    return frame
