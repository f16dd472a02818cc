"""Steps of an episode: physics under a controller, or a recorded motion."""

from collections.abc import Mapping

import mujoco
import numpy as np

from rigcast.dataset.description.config import DatasetConfig
from rigcast.dataset.description.file import RandomActions, RecordedMotion, UserController
from rigcast.motion.recorded import playback, read_motion
from rigcast.motion.steps import Control, Step, control_of, physics
from rigcast.sensors.rig.timing.schedule import uniform

from .randomise import of_free_bodies, place_bodies


def stepper(
    config: DatasetConfig, model: mujoco.MjModel, data: mujoco.MjData, seed: int, poses: Mapping[str, list[float]]
) -> Step:
    """A function that advances `data` by one timestep. poses: displacements of bodies, from `draw_poses`.

    Raises InputError, here or when it is called, if a motion is of another model or the simulation diverges.
    """
    controller = config.file.episodes.controller
    if isinstance(controller, RecordedMotion):
        rows = read_motion(config.folder / controller.file, model)
        free = of_free_bodies(model, poses)  # displacements relative to the recording
        return playback(rows, controller.rate_hz, model, data, lambda data: place_bodies(model, data, free))
    if isinstance(controller, RandomActions):
        return physics(model, data, _random_actions(controller, model, seed))
    if isinstance(controller, UserController):
        return physics(model, data, control_of(config.function(controller.function), model, seed))
    return physics(model, data)


def _random_actions(actions: RandomActions, model: mujoco.MjModel, seed: int) -> Control:
    limited = model.actuator_ctrllimited.astype(bool)
    low = np.where(limited, model.actuator_ctrlrange[:, 0], -1.0)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], 1.0)
    begun = -1

    def control(data: mujoco.MjData) -> None:
        nonlocal begun
        number = int(data.time / actions.hold + 1e-9)
        if number != begun:
            begun = number
            shares = [uniform((seed, "action"), number, k) for k in range(model.nu)]
            data.ctrl[:] = low + (high - low) * np.array(shares)

    return control
