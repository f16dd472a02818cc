"""Readings of a rig as part of a gymnasium environment's observations."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.rig.rig import Rig

load_extra("rigcast.gym", "gymnasium", "gym")

import gymnasium  # noqa: E402  if it is missing, the line above says how to install it
from gymnasium import spaces  # noqa: E402

__all__ = ["RigObservation"]


class RigObservation(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Adds the readings of a rig to every observation: z-depth of cameras, ranges of other sensors, by sensor name.

    The observation becomes a dict. It has the keys of the environment's own observation if that is a dict, else "state"
    for it, and for every sensor a float32 Box of its readings' shape, from 0 to its `max_range` [m]. Policies cannot
    take infinities: where nothing is in range, or the reading is invalid, there is `max_range`, and 0 where something
    is too near. Sensors are read when the observation is made, whatever their rates. `reset(seed=...)` also resets the
    rig to that seed.

    Args:
        env: has a MuJoCo `data` of the rig's model in `env.unwrapped`, like gymnasium's own MuJoCo environments.
        rig: every sensor needs a finite `max_range`, and a name that is not a key of the observation.

    Raises:
        InputError: a sensor without a finite `max_range`, or a name that is taken; at `reset` and `step`, an
            environment without `data`, or with that of another model.

    >>> env = RigObservation(gymnasium.make("Ant-v5"), rig)
    >>> observation, info = env.reset(seed=0)
    >>> observation["top"]  # (beams, columns) float32 [m]
    """

    def __init__(self, env: "gymnasium.Env[Any, Any]", rig: Rig) -> None:
        super().__init__(env)
        self.rig = rig
        self._farthest = {sensor.name: np.float32(sensor.max_range) for sensor in rig.sensors}
        endless = [repr(name) for name, farthest in self._farthest.items() if not np.isfinite(farthest)]
        if endless:
            raise InputError(f"RigObservation: max_range of {', '.join(endless)}: got inf, expected a finite one")
        own = env.observation_space
        known = dict(own.spaces) if isinstance(own, spaces.Dict) else {"state": own}
        taken = [repr(name) for name in self._farthest if name in known]
        if taken:
            raise InputError(f"RigObservation: the observation has {', '.join(taken)} already, expected other names")
        frames = rig.sense(mujoco.MjData(rig.model))
        seen = {
            name: spaces.Box(0.0, farthest, _readings(frames[name]).shape, np.float32)
            for name, farthest in self._farthest.items()
        }
        self.observation_space = spaces.Dict({**known, **seen})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; a seed also resets the rig, so that its readings repeat."""
        if seed is not None:
            self.rig.reset(seed)
        return super().reset(seed=seed, options=options)

    def observation(self, observation: Any) -> dict[str, Any]:
        """The environment's observation with every sensor's readings beside it."""
        data = getattr(self.env.unwrapped, "data", None)
        if not isinstance(data, mujoco.MjData):
            got = type(data).__name__
            raise InputError(f"RigObservation: env.unwrapped.data: got {got}, expected MjData of the rig's model")
        own = observation if isinstance(observation, dict) else {"state": observation}
        frames = self.rig.sense(data)
        return {**own, **{name: self._bounded(frame) for name, frame in frames.items()}}

    def _bounded(self, frame: Frame) -> NDArray[np.float32]:
        farthest = self._farthest[frame.sensor]
        values = np.nan_to_num(_readings(frame), nan=float(farthest), posinf=float(farthest), neginf=0.0)
        return np.clip(values, np.float32(0), farthest)


def _readings(frame: Frame) -> NDArray[np.float32]:
    readings: NDArray[np.float32] = (frame.depth if isinstance(frame, CameraFrame) else frame.range).numpy()
    return readings
